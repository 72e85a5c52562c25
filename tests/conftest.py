"""One thread for the arithmetic of every test: the same sums in the same order, however busy the machine is."""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
