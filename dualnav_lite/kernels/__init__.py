"""Every compiled kernel, one idea a file; nothing here imports from the rest of the package."""
