"""Looks after a sandbox from outside: memory of all its processes and files, how many there are; kills it whole."""

import contextlib
import os
import stat
import threading
from pathlib import Path

MOST_FOLDERS_DEEP = 64  # of what it writes on our disk; deeper is taken for an attempt to hide


def _processes() -> dict[int, tuple[int, int]]:
    """Parent and group of each process."""
    found = {}
    for name in os.listdir("/proc"):
        if name.isdigit():
            with contextlib.suppress(OSError, IndexError, ValueError), open(f"/proc/{name}/stat", "rb") as file:
                words = file.read().rpartition(b")")[2].split()
                found[int(name)] = int(words[1]), int(words[2])
    return found


def members(first: int, uid: int) -> list[int]:
    """Processes of a sandbox: descendants of its first one, its group, and where it has a user of its own, his.

    Args:
        first: its first process.
        uid: its user; 0 where it has none of its own.
    """
    processes = _processes()
    found = {first} | {pid for pid, (_, group) in processes.items() if group == first}
    grown = True
    while grown:
        more = {pid for pid, (parent, _) in processes.items() if parent in found and pid not in found}
        grown = bool(more)
        found |= more
    if uid:
        for pid in processes:
            with contextlib.suppress(OSError):
                if os.stat(f"/proc/{pid}").st_uid == uid:
                    found.add(pid)
    return sorted(found & processes.keys())


def _kilobytes(path: str, names: tuple[bytes, ...]) -> int:
    """Sum of some lines of a file in /proc [bytes]; 0 where the process is gone."""
    total = 0
    with contextlib.suppress(OSError, ValueError, IndexError), open(path, "rb") as file:
        for line in file:
            if line.startswith(names):
                total += int(line.split()[1]) * 1024
    return total


def resident(pid: int) -> int:
    """Memory of a process with all that it shares, with its page tables and with what was swapped out [bytes]."""
    return _kilobytes(f"/proc/{pid}/status", (b"VmRSS:", b"VmSwap:", b"VmPTE:"))


def memory_of(pid: int) -> int:
    """As `resident`, but proportional [bytes]: pages that n processes share count 1/n."""
    proportional = _kilobytes(f"/proc/{pid}/smaps_rollup", (b"Pss:", b"SwapPss:"))
    return proportional + _kilobytes(f"/proc/{pid}/status", (b"VmPTE:",)) if proportional else resident(pid)


def descriptors_of(pid: int) -> int:
    """Open files of a process: each may hold memory in the kernel that no process shows."""
    folder = f"/proc/{pid}/fd"
    with contextlib.suppress(OSError):
        return os.stat(folder).st_size or len(os.listdir(folder))  # the size is their number since Linux 6.2
    return 0


class Hidden(Exception):
    """Files that cannot be counted."""


def files_below(folder: Path) -> tuple[int, int]:
    """Bytes and number of files and folders below a folder of ours.

    Raises:
        Hidden: folders too deep, or not to be listed.
    """
    size = number = 0
    waiting = [(str(folder), 0)]
    while waiting:
        place, depth = waiting.pop()
        try:
            entries = list(os.scandir(place))
        except FileNotFoundError:
            continue  # removed since
        except OSError:
            raise Hidden from None
        for entry in entries:
            number += 1
            try:
                status = entry.stat(follow_symlinks=False)
            except FileNotFoundError:
                continue
            except OSError:  # such as a path that is too long
                raise Hidden from None
            size += status.st_blocks * 512
            if stat.S_ISDIR(status.st_mode):
                if depth == MOST_FOLDERS_DEEP:
                    raise Hidden
                waiting.append((entry.path, depth + 1))
    return size, number


def nameless_files(pids: list[int]) -> int:
    """Bytes of open files that have been unlinked."""
    found = {}
    for pid in pids:
        with contextlib.suppress(OSError):
            for handle in os.listdir(f"/proc/{pid}/fd"):
                with contextlib.suppress(OSError):
                    status = os.stat(f"/proc/{pid}/fd/{handle}")
                    if stat.S_ISREG(status.st_mode) and status.st_nlink == 0:
                        found[status.st_dev, status.st_ino] = status.st_blocks * 512
    return sum(found.values())


class Watchdog(threading.Thread):
    """Kills a sandbox that takes more than its share.

    Args:
        first: its first process, as seen from here.
        limits: `job.Limits`.
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
            try:
                reason = self._too_much()
            except Exception:  # whatever it does that we cannot follow must not go on unwatched
                reason = "unseen"
            if reason and not self._ended.is_set():
                self.reason = reason
                self._kill()
                return

    def stop(self) -> None:
        """Look no more."""
        self._ended.set()

    def members(self) -> list[int]:
        """Processes of the sandbox."""
        return members(self._first, self._uid)

    def _too_much(self) -> str:
        limits, pids = self._limits, self.members()
        tasks = 0
        for pid in pids:
            with contextlib.suppress(OSError):
                tasks += len(os.listdir(f"/proc/{pid}/task"))
        if tasks > 2 * limits.processes:
            return "processes"
        if sum(descriptors_of(pid) for pid in pids) > limits.descriptors:
            return "descriptors"
        try:
            size, files = self._files(pids)
        except Hidden:
            return "disk"
        if files > limits.files or size > limits.disk_mb << 20:
            return "disk"
        most = limits.memory_mb << 20
        used = size + sum(resident(pid) for pid in pids)
        if used > most:  # the dear measure only where the cheap one is alarmed
            used = size + sum(memory_of(pid) for pid in pids)
        self.most_memory = max(self.most_memory, used)
        return "memory" if used > most else ""

    def _files(self, pids: list[int]) -> tuple[int, int]:
        """Bytes and number of the files that it made."""
        if self._work:
            size, files = files_below(self._work)
            return size + nameless_files(pids), files
        size = files = 0
        for place in ("tmp", "dev/shm"):
            with contextlib.suppress(OSError):
                found = os.statvfs(f"/proc/{self._first}/root/{place}")
                size += (found.f_blocks - found.f_bfree) * found.f_frsize
                files += found.f_files - found.f_ffree
        return size, files
