"""Tier B's start, and the start without any sandbox: a process without namespaces, whose orphans come to us."""

import contextlib
import ctypes
import os
import subprocess

CHILD_SUBREAPER = 36  # PR_SET_CHILD_SUBREAPER


def start(program: list[str], environment: dict[str, str]) -> subprocess.Popen:
    """The first process, in a session of its own."""
    _adopt_orphans()
    return subprocess.Popen(
        program,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=environment,
        start_new_session=True,
    )


def own_tasks() -> int:
    """Threads of this user: before Linux 5.14 a limit inside a namespace counts those outside too."""
    total, uid = 0, os.getuid()
    for entry in os.scandir("/proc"):
        if entry.name.isdigit():
            with contextlib.suppress(OSError):
                if entry.stat().st_uid == uid:
                    total += len(os.listdir(f"/proc/{entry.name}/task"))
    return total


def _adopt_orphans() -> None:
    """Make daemons of a sandbox without a process namespace our children, so that they can be found and ended."""
    ctypes.CDLL(None).prctl(CHILD_SUBREAPER, 1, 0, 0, 0)
