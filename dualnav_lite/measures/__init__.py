"""Measurements beside the survival table, a file each; `tables` knows them by name."""
