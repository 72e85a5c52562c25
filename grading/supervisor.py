"""Stays outside what it looks after: where there is no process namespace, it ends a sandbox whole.

All of a tier B sandbox is one process group, which the seccomp filter lets nobody leave, so that one signal ends all of
it however fast its processes come and go. It is sent when the first process has ended, and when the grader is gone.
"""

import ctypes
import os
import select
import signal

CHILD_SUBREAPER = 36  # PR_SET_CHILD_SUBREAPER


def supervise(lifeline: int) -> None:
    """Return in a child, whose end and whose orphans this process waits for; it never returns itself.

    Args:
        lifeline: reading end of a pipe whose other end the grader holds and nobody else.
    """
    ctypes.CDLL(None).prctl(CHILD_SUBREAPER, 1, 0, 0, 0)
    first = os.fork()
    if first == 0:
        os.close(lifeline)
        return
    while not select.select([lifeline], [], [], 0.05)[0]:
        pid = -1
        while pid:
            pid, _ = os.waitpid(-1, os.WNOHANG)
            if pid == first:
                os.killpg(0, signal.SIGKILL)
    os.killpg(0, signal.SIGKILL)
