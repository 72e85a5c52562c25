"""One thread for the arithmetic of every test: the same sums in the same order, however busy the machine is."""

import os
import sys

os.environ.setdefault("OMP_NUM_THREADS", "1")
collect_ignore = (
    [] if sys.platform == "linux" else ["test_grading.py", "test_attacks.py", "test_grading_sandbox.py"]
)  # only Linux has what the sandbox is made of
