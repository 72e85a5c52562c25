"""Tier B's start, and the start without any sandbox: no namespaces, but a supervisor, a group and a lifeline."""

import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from grading.bubblewrap import GIVING_WAY


def start(program: list[str], environment: dict[str, str], lifeline: int) -> subprocess.Popen:
    """The supervisor of a sandbox, first of a session and group of its own.

    Args:
        program: `inside.py` and its job.
        environment: every variable it gets.
        lifeline: reading end of a pipe; the sandbox ends when its other end is closed.
    """
    return subprocess.Popen(
        [*GIVING_WAY, *program],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=environment,
        start_new_session=True,
        pass_fds=[lifeline],
    )


def kill(first: int, members: Callable[[], list[int]]) -> None:
    """End a sandbox: first those who have left the group, which nobody can in tier B; then the group with its leader.

    Args:
        first: its supervisor.
        members: gives its processes.
    """
    deadline = time.monotonic() + 5
    while time.monotonic() < deadline:
        strays = [pid for pid in members() if pid != first and _group(pid) not in (first, None)]
        if not strays:
            break
        for pid in strays:
            with contextlib.suppress(OSError):
                os.kill(pid, signal.SIGKILL)
        time.sleep(0.02)
    with contextlib.suppress(OSError):
        os.killpg(first, signal.SIGKILL)


def _group(pid: int) -> int | None:
    with contextlib.suppress(OSError):
        return os.getpgid(pid)
    return None


def remove(folder: Path) -> None:
    """Take a folder away however deep it is and whatever its modes say; Python's own way gives up at a depth."""
    # A folder that its owner may not list has to be opened before it can be emptied.
    for command in (["rm", "-rf", "--"], ["chmod", "-R", "u+rwX", "--"], ["rm", "-rf", "--"]):
        if os.path.lexists(folder):
            subprocess.run([*command, str(folder)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def own_tasks() -> int:
    """Threads of this user: before Linux 5.14 a limit inside a namespace counts those outside too."""
    total, uid = 0, os.getuid()
    for entry in os.scandir("/proc"):
        if entry.name.isdigit():
            with contextlib.suppress(OSError):
                if entry.stat().st_uid == uid:
                    total += len(os.listdir(f"/proc/{entry.name}/task"))
    return total
