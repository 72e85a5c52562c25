"""Looks after a sandbox from outside: memory of all its processes and files, how many there are; kills it whole."""

import contextlib
import os
import signal
import threading
import time
from pathlib import Path

PAGE = os.sysconf("SC_PAGE_SIZE")


def _parents() -> dict[int, int]:
    """Parent of each process."""
    found = {}
    for name in os.listdir("/proc"):
        if name.isdigit():
            with contextlib.suppress(OSError, IndexError, ValueError), open(f"/proc/{name}/stat", "rb") as file:
                found[int(name)] = int(file.read().rpartition(b")")[2].split()[1])
    return found


def members(first: int, uid: int, own: int | None = None) -> list[int]:
    """Processes of a sandbox: descendants of its first one, and where it has a user of its own, all of that user's.

    Args:
        first: its first process.
        uid: its user; 0 where it has none of its own.
        own: process that orphans of it become children of; those count, but for `first`'s siblings of other kinds.
    """
    parents = _parents()
    found = {first}
    grown = True
    while grown:
        more = {pid for pid, parent in parents.items() if parent in found and pid not in found}
        grown = bool(more)
        found |= more
    if uid:
        for pid in parents:
            with contextlib.suppress(OSError):
                if os.stat(f"/proc/{pid}").st_uid == uid:
                    found.add(pid)
    elif own:
        found |= {pid for pid, parent in parents.items() if parent == own and _is_new_session(pid)}
    return sorted(found & parents.keys())


def _is_new_session(pid: int) -> bool:
    """Whether a process is in another session than we are, as every sandbox is."""
    with contextlib.suppress(OSError):
        return os.getsid(pid) != os.getsid(0)
    return False


def memory_of(pid: int) -> int:
    """Proportional memory of a process [bytes]: pages that n processes share count 1/n."""
    with contextlib.suppress(OSError, ValueError), open(f"/proc/{pid}/smaps_rollup", "rb") as file:
        for line in file:
            if line.startswith(b"Pss:"):
                return int(line.split()[1]) * 1024
    return resident(pid)


def resident(pid: int) -> int:
    """Memory of a process with all that it shares [bytes]."""
    with contextlib.suppress(OSError, ValueError, IndexError), open(f"/proc/{pid}/statm", "rb") as file:
        return int(file.read().split()[1]) * PAGE
    return 0


class Watchdog(threading.Thread):
    """Kills a sandbox that takes more than its share.

    Args:
        first: its first process, as seen from here.
        limits: `sandbox.Limits`.
        kill: what ends it.
        work: its folder on our disk, where it has no file system of its own.
        uid: its own user, 0 for none.
    """

    def __init__(self, first: int, limits, kill, work: Path | None, uid: int):
        super().__init__(daemon=True)
        self._first, self._limits, self._kill, self._work, self._uid = first, limits, kill, work, uid
        self._ended = threading.Event()
        self.reason = ""
        self.most_memory = 0

    def run(self) -> None:
        while not self._ended.wait(0.05):
            reason = self._too_much()
            if reason and not self._ended.is_set():
                self.reason = reason
                self._kill()
                return

    def stop(self) -> None:
        """Look no more."""
        self._ended.set()

    def _members(self) -> list[int]:
        return members(self._first, self._uid, os.getpid() if self._work else None)

    def kill_all(self) -> None:
        """End all processes of a sandbox that has no namespace of its own; until none is left or 5 s are over."""
        deadline = time.monotonic() + 5
        while time.monotonic() < deadline:
            alive = [pid for pid in self._members() if pid != os.getpid()]
            for pid in alive:
                with contextlib.suppress(OSError):
                    os.kill(pid, signal.SIGKILL)
                if pid != self._first:
                    with contextlib.suppress(OSError):
                        os.waitpid(pid, os.WNOHANG)
            if not alive or alive == [self._first]:
                return
            time.sleep(0.02)

    def _too_much(self) -> str:
        limits, pids = self._limits, self._members()
        tasks = 0
        for pid in pids:
            with contextlib.suppress(OSError):
                tasks += len(os.listdir(f"/proc/{pid}/task"))
        if tasks > 2 * limits.processes:
            return "processes"
        size, files = self._files()
        if files > limits.files or size > limits.disk_mb << 20:
            return "disk"
        most = limits.memory_mb << 20
        used = size + sum(resident(pid) for pid in pids)
        if used > most:  # the dear measure only where the cheap one is alarmed
            used = size + sum(memory_of(pid) for pid in pids)
        self.most_memory = max(self.most_memory, used)
        return "memory" if used > most else ""

    def _files(self) -> tuple[int, int]:
        """Bytes and number of the files that it made."""
        if self._work:
            size = files = 0
            for folder, _, names in os.walk(self._work):
                for name in names:
                    with contextlib.suppress(OSError):
                        size += os.lstat(os.path.join(folder, name)).st_blocks * 512
                        files += 1
            return size, files
        size = files = 0
        for place in ("tmp", "dev/shm"):
            with contextlib.suppress(OSError):
                found = os.statvfs(f"/proc/{self._first}/root/{place}")
                size += (found.f_blocks - found.f_bfree) * found.f_frsize
                files += found.f_files - found.f_ffree
        return size, files
