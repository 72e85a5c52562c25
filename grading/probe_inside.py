"""Runs in a sandbox: tries what must be denied and answers with one number each, 1 where it was denied.

The scorer trusts the answers only because nothing of others runs beside it in this sandbox.
"""

import contextlib
import ctypes
import errno
import os
import resource
import signal
import socket
import subprocess
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))

import numpy as np
import wire

LIBC = ctypes.CDLL(None, use_errno=True)


def fails(action) -> bool:
    """Whether an action raises an OSError."""
    try:
        action()
    except OSError:
        return True
    return False


def refused(number: int, *arguments) -> bool:
    """Whether the kernel refuses a system call as such, whatever its arguments."""
    ctypes.set_errno(0)
    result = LIBC.syscall(number, *arguments)
    return result == -1 and ctypes.get_errno() in (errno.EPERM, errno.ENOSYS)


def no_socket(family: int) -> bool:
    return fails(lambda: socket.socket(family, socket.SOCK_STREAM).close())


def reach(address: str) -> bool:
    """Whether somebody's unix socket takes a connection."""
    client = socket.socket(socket.AF_UNIX)
    try:
        client.connect(address)
    except OSError:
        return False
    finally:
        client.close()
    return True


def others_unseen() -> bool:
    """Whether no process of the host is seen: those here are bubblewrap and we."""
    try:
        return len([name for name in os.listdir("/proc") if name.isdigit()]) <= 4
    except OSError:
        return True


def shut(path, mode: str) -> bool:
    """Whether a file cannot be opened."""
    try:
        with open(path, mode):
            return False
    except OSError:
        return True


def content(path: str) -> bytes:
    """Of a file; nothing where it cannot be read."""
    try:
        return Path(path).read_bytes()
    except OSError:
        return b""


def raises_limit() -> bool:
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard + 1, hard + 1))
    except (OSError, ValueError):
        return False
    return True


def own_work() -> bool:
    path = Path("probe")
    path.write_text("x", encoding="utf-8")
    path.unlink()
    return True


def stays_first_to_go() -> bool:
    """Whether a program keeps the mark by which the kernel ends it first; tried by a new one, which owns its /proc."""
    change = "open('/proc/self/oom_score_adj', 'w').write('0')"
    return subprocess.run([sys.executable, "-I", "-c", change], stderr=subprocess.DEVNULL).returncode != 0


TRIALS = {
    "internet": lambda: no_socket(socket.AF_INET) and no_socket(socket.AF_INET6),
    "vsock": lambda: no_socket(40),
    "packet": lambda: no_socket(17),
    "abstract_socket": lambda: not reach("\0" + os.environ["PROBE_ABSTRACT"]),
    "path_socket": lambda: not reach(os.environ["PROBE_SOCKET"]),
    "host_file": lambda: shut(os.environ["PROBE_FILE"], "rb"),
    "host_signal": lambda: fails(lambda: os.kill(int(os.environ["PROBE_PID"]), signal.SIGTERM)),
    "host_environment": lambda: shut(f"/proc/{os.environ['PROBE_PID']}/environ", "rb"),
    "first_environment": lambda: b"PROBE_CANARY" not in content("/proc/1/environ"),
    "processes": others_unseen,
    "write_root": lambda: shut("/probe", "wb"),
    "write_dev": lambda: shut("/dev/probe", "wb"),
    "write_python": lambda: shut(os.path.join(sys.prefix, "probe"), "wb"),
    "write_grader": lambda: shut(Path(__file__).parent / "probe", "wb"),
    "memory_mark": stays_first_to_go,
    "write_kernel": lambda: shut("/proc/sys/kernel/core_pattern", "wb"),
    "ptrace": lambda: refused(101, 0, 0, 0, 0),
    "process_vm": lambda: refused(310, os.getpid(), None, 0, None, 0, 0) and refused(311, os.getpid(), None, 0),
    "unshare": lambda: refused(272, 0x10000000),
    "new_user": lambda: refused(56, 0x10000000 | signal.SIGCHLD, None, None, None, None),
    "clone3": lambda: refused(435, None, 0),
    "mount": lambda: refused(165, None, None, None, 0, None),
    "bpf": lambda: refused(321, 0, None, 0),
    "io_uring": lambda: refused(425, 1, None),
    "keyring": lambda: refused(250, 0, 0, 0, 0, 0),
    "memory_file": lambda: refused(319, b"x", 0),
    "tiocsti": lambda: refused(16, 0, 0x5412, ctypes.c_char_p(b"x")),
    "limits": lambda: not raises_limit(),
    "capabilities": lambda: fails(lambda: os.setuid(54321)) and fails(lambda: os.chroot("/")),
    "works": own_work,
}


def main() -> None:
    found = {}
    for name, trial in TRIALS.items():
        try:
            found[name] = np.array(int(bool(trial())), np.int64)
        except Exception:
            found[name] = np.array(-1, np.int64)
    client = socket.socket(socket.AF_UNIX)
    client.connect(os.environ["GRADING_SOCKET"])
    connection = wire.Connection(client)
    connection.send(wire.pack("hello", 0, "", found))
    with contextlib.suppress(wire.ProtocolError):
        connection.receive()


if __name__ == "__main__":
    main()
