"""Landlock: a process gives up the file system and the network for good, without namespaces (tier B)."""

import ctypes
import errno
import os
import struct

CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446
VERSION_FLAG, PATH_BENEATH = 1, 1
NEEDED_ABI = 6  # Linux 6.12: the first that keeps signals and abstract sockets inside
# linux/landlock.h: every right on files, by bit.
EXECUTE, WRITE_FILE, READ_FILE, READ_DIR = 1 << 0, 1 << 1, 1 << 2, 1 << 3
TRUNCATE, IOCTL_DEVICE = 1 << 14, 1 << 15
ALL_FILES = (1 << 16) - 1
MAKE_DEVICES = (1 << 6) | (1 << 10) | (1 << 11)  # character device, fifo, block device
READ = EXECUTE | READ_FILE | READ_DIR
WORK = ALL_FILES & ~(MAKE_DEVICES | IOCTL_DEVICE)
NETWORK = 0b11  # TCP bind and connect
SCOPED = 0b11  # abstract sockets, signals


def _call(number: int, *arguments) -> int:
    libc = ctypes.CDLL(None, use_errno=True)
    result = libc.syscall(number, *arguments)
    if result < 0:
        raise OSError(ctypes.get_errno(), "landlock refused")
    return result


def abi() -> int:
    """Version that the kernel speaks; 0 where there is no Landlock."""
    try:
        return _call(CREATE_RULESET, None, ctypes.c_size_t(0), VERSION_FLAG)
    except OSError:
        return 0


def restrict(readable: list[str], writable: list[str], devices: list[str]) -> None:
    """Give up everything but these paths; this process and all its later children.

    Args:
        readable: files and folders that may be read and executed.
        writable: folders where everything but devices may be made.
        devices: files that may be read and written.

    Raises:
        OSError: no Landlock that is new enough.
    """
    if abi() < NEEDED_ABI:
        raise OSError(errno.ENOSYS, "Landlock is missing or older than Linux 6.12")
    attributes = struct.pack("<QQQ", ALL_FILES, NETWORK, SCOPED)
    ruleset = _call(CREATE_RULESET, attributes, ctypes.c_size_t(len(attributes)), 0)
    for paths, rights in ((readable, READ), (writable, WORK), (devices, READ_FILE | WRITE_FILE)):
        for path in paths:
            try:
                handle = os.open(path, os.O_PATH | os.O_CLOEXEC)
            except FileNotFoundError:
                continue
            allowed = rights if os.path.isdir(path) else rights & (EXECUTE | READ_FILE | WRITE_FILE | TRUNCATE)
            rule = struct.pack("<Qi", allowed, handle)
            _call(ADD_RULE, ruleset, PATH_BENEATH, rule, 0)
            os.close(handle)
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl(38, 1, 0, 0, 0)
    _call(RESTRICT_SELF, ruleset, 0)
    os.close(ruleset)
