"""A core for each sandbox: whoever starts a hundred busy processes slows himself, and nobody who is graded beside him.

The seccomp filter lets nobody inside change where he runs. With more sandboxes side by side than cores, the rest share.
"""

import contextlib
import os
import socket


@contextlib.contextmanager
def on_a_core(slot: socket.socket | None, core: int):
    """What this thread starts in the block runs on one core; without a slot on any."""
    before = os.sched_getaffinity(0)
    if slot:
        os.sched_setaffinity(0, {core})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def take_core() -> tuple[socket.socket | None, int]:
    """A core that no other sandbox of any grader has, and what keeps it taken until it is closed; None where none is.

    It is kept by a name that ends with its owner, however that one ends.
    """
    for core in sorted(os.sched_getaffinity(0)):
        slot = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            slot.bind(f"\0dualnav-grading-core-{core}")
        except OSError:
            slot.close()
            continue
        return slot, core
    return None, -1
