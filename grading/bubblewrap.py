"""Tier A's command line: bubblewrap's mounts and namespaces.

Started by root, the mounts are made by root and the program then becomes a user of its own without capabilities, so
that limits on processes hold and nothing in root's folders has to be opened to others. Started by anybody else, it gets
a user namespace.
"""

import json
import os
import shutil
import subprocess
from pathlib import Path

from grading.job import Limits, SandboxError
from grading.shown import hidden_copies, system_folders

MEGABYTE = 1 << 20
# Whoever looks after a sandbox from outside comes first; where the machine's memory runs out, the sandbox goes first.
GIVING_WAY = ["sh", "-c", 'echo 1000 > /proc/self/oom_score_adj; exec nice -n 5 "$@"', "sh"]


def is_root() -> bool:
    """Whether this process may become anybody."""
    return os.geteuid() == 0


def isolation() -> list[str]:
    """Options that make the namespaces."""
    options = ["--unshare-pid", "--unshare-net", "--unshare-ipc", "--unshare-uts", "--unshare-cgroup-try"]
    options += ["--hostname", "sandbox", "--new-session", "--die-with-parent", "--cap-drop", "ALL"]
    if is_root():  # `inside.py` becomes somebody else, and has no capability left afterwards
        return [*options, "--cap-add", "CAP_SETUID", "--cap-add", "CAP_SETGID"]
    return [*options, "--unshare-user", "--disable-userns", "--uid", "1000", "--gid", "1000"]


def mounts(folder: Path, packages: Path | None, limits: Limits) -> list[str]:
    """Options that make what is seen inside.

    Args:
        folder: of the sandbox; its `grader` and `socket` are shown in `/grader`.
        packages: masked library, shown in `/grader/packages`.
        limits: of the disk.
    """
    options = ["--proc", "/proc", "--dev", "/dev"]
    options += ["--perms", "1777", "--size", str(16 * MEGABYTE), "--tmpfs", "/dev/shm"]
    # Before the interpreter's folders: a checkout may lie in /tmp itself.
    options += ["--perms", "1777", "--size", str(limits.disk_mb * MEGABYTE), "--tmpfs", "/tmp"]
    for path in system_folders():
        for parent in reversed(Path(path).parents[:-1]):  # else bubblewrap makes them for root's eyes alone
            options += ["--perms", "0755", "--dir", str(parent)]
        if os.path.islink(path):
            options += ["--symlink", os.path.realpath(path), path]
        else:
            options += ["--ro-bind", path, path]
    for path in hidden_copies():
        options += ["--size", "4096", "--tmpfs", path, "--remount-ro", path]
    options += ["--ro-bind", str(folder / "grader"), "/grader"]
    if packages:  # the mount point must be there before the read-only mount
        (folder / "grader" / "packages").mkdir()
        options += ["--ro-bind", str(packages), "/grader/packages"]
    (folder / "grader" / "socket").mkdir()
    options += ["--ro-bind", str(folder / "socket"), "/grader/socket"]
    return [*options, "--remount-ro", "/dev", "--remount-ro", "/proc", "--remount-ro", "/", "--chdir", "/tmp"]


def start(program: list[str], environment: dict[str, str], options: list[str]) -> tuple[subprocess.Popen, int]:
    """bubblewrap's process, and as seen from here the first process inside, with which all others end.

    Raises:
        SandboxError: it ended before the first process was there.
    """
    told, tell = os.pipe()
    options = [*options, "--info-fd", str(tell)]
    # As a file and not as arguments, which everybody inside could read in /proc/1/cmdline.
    handle = _memory_file(b"".join(option.encode() + b"\0" for option in options))
    try:
        process = subprocess.Popen(
            [*GIVING_WAY, shutil.which("bwrap"), "--args", str(handle), "--", *program],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=environment,
            pass_fds=[handle, tell],
            start_new_session=True,
        )
    finally:
        os.close(handle)
        os.close(tell)
    with os.fdopen(told, "rb") as file:
        answer = file.read(4096)
    try:
        first = json.loads(answer)["child-pid"]
    except (ValueError, KeyError):
        process.wait(timeout=10)
        with process.stdout as stream:
            words = " ".join(stream.read(2000).decode("utf-8", "replace").split())
        raise SandboxError(f"bubblewrap does not start: {words[:300]}") from None
    return process, first


def _memory_file(content: bytes) -> int:
    """An unnamed file that a child may read from its start."""
    handle = os.memfd_create("job", 0)
    with os.fdopen(os.dup(handle), "wb") as file:
        file.write(content)
    os.lseek(handle, 0, os.SEEK_SET)
    return handle
