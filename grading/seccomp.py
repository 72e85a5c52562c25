"""A seccomp filter, written out by hand: what a notebook never needs is refused by the kernel. x86-64 only.

Refused with ENOSYS: `clone3` (its flags cannot be read by a filter; libc falls back to `clone`) and everything newer
than the list below knows. Refused with EPERM: the rest, but for a few that are answered with success and not done.
No library assembles it, since none is in requirements.txt.
"""

import ctypes
import errno
import platform
import struct

ARCHITECTURE = 0xC000003E  # AUDIT_ARCH_X86_64
X32_BIT = 0x40000000
LOAD, EQUAL, AT_LEAST, ANY_BIT, RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
KILL, ALLOW, ERRNO = 0x80000000, 0x7FFF0000, 0x00050000
NUMBER, ARCH = 0, 4  # offsets in struct seccomp_data

# https://github.com/torvalds/linux/blob/master/arch/x86/entry/syscalls/syscall_64.tbl
DENIED = {
    "shmget": 29, "shmat": 30, "shmctl": 31, "semget": 64, "semop": 65, "semctl": 66, "shmdt": 67, "msgget": 68,
    "msgsnd": 69, "msgrcv": 70, "msgctl": 71, "ptrace": 101, "syslog": 103,
    "mknod": 133, "uselib": 134, "ustat": 136, "sysfs": 139, "vhangup": 153,
    "modify_ldt": 154, "pivot_root": 155, "_sysctl": 156, "adjtimex": 159, "chroot": 161, "acct": 163,
    "settimeofday": 164, "mount": 165, "umount2": 166, "swapon": 167, "swapoff": 168, "reboot": 169,
    "sethostname": 170, "setdomainname": 171, "iopl": 172, "ioperm": 173, "create_module": 174, "init_module": 175,
    "delete_module": 176, "get_kernel_syms": 177, "query_module": 178, "quotactl": 179, "nfsservctl": 180,
    "lookup_dcookie": 212, "semtimedop": 220, "clock_settime": 227, "mbind": 237, "set_mempolicy": 238,
    "migrate_pages": 256, "mknodat": 259, "unshare": 272, "move_pages": 279, "vmsplice": 278, "mq_open": 240,
    "mq_unlink": 241, "mq_timedsend": 242, "mq_timedreceive": 243, "mq_notify": 244, "mq_getsetattr": 245,
    "kexec_load": 246, "add_key": 248, "request_key": 249, "keyctl": 250, "perf_event_open": 298,
    "fanotify_init": 300, "fanotify_mark": 301, "name_to_handle_at": 303, "open_by_handle_at": 304,
    "clock_adjtime": 305, "setns": 308, "process_vm_readv": 310, "process_vm_writev": 311, "kcmp": 312,
    "finit_module": 313, "kexec_file_load": 320, "memfd_create": 319, "bpf": 321, "userfaultfd": 323,
    "pidfd_send_signal": 424, "setpriority": 141, "ioprio_set": 251, "inotify_init": 253, "inotify_init1": 294,
    "io_setup": 206,  # takes from what all of this machine's programs share
    "setxattr": 188, "lsetxattr": 189, "fsetxattr": 190, "removexattr": 197, "lremovexattr": 198, "fremovexattr": 199,
}  # fmt: skip
# Answered with success and not done: libzmq sets how its threads are scheduled and aborts where it may not; a sync is
# of all disks of this machine.
PRETENDED = {"sched_setparam": 142, "sched_setscheduler": 144, "sched_setaffinity": 203, "sched_setattr": 314,
             "sync": 162, "syncfs": 306}  # fmt: skip
# What mounts keep from doing harm in tier A and Landlock does not look at. Sockets with a path: one may be a session
# bus or a container's daemon, through which programs are started outside; so there are no symbolic links, the working
# folder stays, and addresses are too short for any socket elsewhere. Modes, owners and times of files that are ours:
# not done, and answered with success, since IPython copies its files with their modes. One group holds all processes.
DENIED_WITHOUT_MOUNTS = {"symlink": 88, "symlinkat": 266}
PRETENDED_WITHOUT_MOUNTS = {
    "chmod": 90, "fchmod": 91, "chown": 92, "fchown": 93, "lchown": 94, "utime": 132, "utimes": 235, "fchownat": 260,
    "futimesat": 261, "fchmodat": 268, "utimensat": 280, "chdir": 80, "fchdir": 81, "setpgid": 109, "setsid": 112,
}  # fmt: skip
SOCKET, CLONE, IOCTL, PRLIMIT, PERSONALITY, SOCKETPAIR, CONNECT, BIND = 41, 56, 16, 302, 135, 53, 42, 49
LONGEST_ADDRESS = 2 + 3 + 1  # family, a name of three characters in the working folder, NUL
LONGEST_OWN = 12  # of an address to listen at: libzmq asks for interfaces at one of that length
NOT_A_STREAM = 0b1110  # bits of a socket's kind that SOCK_STREAM has not
NEWEST_OLD = 424  # the numbers after it were given out since Linux 5.2; only these are let through
NEWER_ALLOWED = {"pidfd_open": 434, "close_range": 436, "openat2": 437, "faccessat2": 439, "epoll_pwait2": 441,
                 "futex_waitv": 449, "map_shadow_stack": 453}  # fmt: skip
NEW_NAMESPACES = 0x7E020080  # CLONE_NEWTIME, NEWNS, NEWCGROUP, NEWUTS, NEWIPC, NEWUSER, NEWPID, NEWNET
TIOCSTI, TIOCLINUX = 0x5412, 0x541C
AF_UNIX, AF_NETLINK, NETLINK_ROUTE = 1, 16, 0


def _argument(index: int, high: bool = False) -> int:
    """Offset of the low or high half of a syscall's argument."""
    return 16 + 8 * index + 4 * high


class _Program:
    """Instructions with jumps to labels, all forward."""

    def __init__(self):
        self._lines: list[tuple] = []
        self._labels: dict[str, int] = {}

    def load(self, offset: int) -> None:
        self._lines.append((LOAD, offset, None, None))

    def jump(self, test: int, value: int, yes: str | None = None, no: str | None = None) -> None:
        self._lines.append((test, value, yes, no))

    def give(self, value: int) -> None:
        self._lines.append((RETURN, value, None, None))

    def label(self, name: str) -> None:
        self._labels[name] = len(self._lines)

    def assemble(self) -> bytes:
        code = b""
        for here, (test, value, yes, no) in enumerate(self._lines):
            steps = [self._labels[name] - here - 1 if name else 0 for name in (yes, no)]
            if not all(0 <= step <= 255 for step in steps):
                raise ValueError(f"jump of {steps} instructions at {here}")
            code += struct.pack("<HBBI", test, *steps, value)
        return code


def is_supported() -> bool:
    """Whether this machine's system calls are the ones that the filter knows."""
    return platform.system() == "Linux" and platform.machine() == "x86_64"


def program(mounts: bool = True) -> bytes:
    """The filter as an array of `struct sock_filter`, which bubblewrap and the kernel take.

    Args:
        mounts: whether mounts keep the host's files and sockets out of sight; where not, more is denied.
    """
    p = _Program()
    p.load(ARCH)
    p.jump(EQUAL, ARCHITECTURE, no="kill")
    p.load(NUMBER)
    p.jump(AT_LEAST, X32_BIT, yes="kill")
    for call, name in ((SOCKET, "socket"), (CLONE, "clone"), (IOCTL, "ioctl"), (PRLIMIT, "prlimit")):
        p.jump(EQUAL, call, yes=name)
    p.jump(EQUAL, PERSONALITY, yes="personality")
    if not mounts:
        for call, name in ((SOCKETPAIR, "kind"), (CONNECT, "address"), (BIND, "own")):
            p.jump(EQUAL, call, yes=name)
    p.jump(AT_LEAST, NEWEST_OLD + 1, yes="newer")
    for number in sorted((DENIED if mounts else DENIED | DENIED_WITHOUT_MOUNTS).values()):
        p.jump(EQUAL, number, yes="eperm")
    for number in sorted((PRETENDED if mounts else PRETENDED | PRETENDED_WITHOUT_MOUNTS).values()):
        p.jump(EQUAL, number, yes="pretend")
    p.give(ALLOW)
    p.label("newer")
    for number in NEWER_ALLOWED.values():
        p.jump(EQUAL, number, yes="allow")
    p.give(ERRNO | errno.ENOSYS)
    p.label("socket")
    p.load(_argument(0))
    p.jump(EQUAL, AF_UNIX, yes="allow" if mounts else "kind")
    p.jump(EQUAL, AF_NETLINK, no="eperm")
    p.load(_argument(2))
    p.jump(EQUAL, NETLINK_ROUTE, yes="allow", no="eperm")
    if not mounts:
        p.label("kind")
        p.load(_argument(1))
        p.jump(ANY_BIT, NOT_A_STREAM, yes="eperm", no="allow")
        p.label("address")
        p.load(_argument(2))
        p.jump(AT_LEAST, LONGEST_ADDRESS + 1, yes="eperm", no="allow")
        p.label("own")
        p.load(_argument(2))
        p.jump(AT_LEAST, LONGEST_OWN + 1, yes="eperm", no="allow")
    p.label("clone")
    p.load(_argument(0))
    p.jump(ANY_BIT, NEW_NAMESPACES, yes="eperm", no="allow")
    p.label("ioctl")
    p.load(_argument(1))
    p.jump(EQUAL, TIOCSTI, yes="eperm")
    p.jump(EQUAL, TIOCLINUX, yes="eperm", no="allow")
    p.label("prlimit")  # reading a limit is allowed, setting one is not
    p.load(_argument(2))
    p.jump(EQUAL, 0, no="eperm")
    p.load(_argument(2, high=True))
    p.jump(EQUAL, 0, yes="allow", no="eperm")
    p.label("personality")  # 0xffffffff asks which one it is
    p.load(_argument(0))
    p.jump(EQUAL, 0xFFFFFFFF, yes="allow")
    p.jump(EQUAL, 0, yes="allow", no="eperm")
    p.label("pretend")
    p.give(ERRNO)
    p.label("eperm")
    p.give(ERRNO | errno.EPERM)
    p.label("allow")
    p.give(ALLOW)
    p.label("kill")
    p.give(KILL)
    return p.assemble()


def apply(code: bytes) -> None:
    """Put this process and all its later children under a filter, for good.

    Raises:
        OSError: the kernel refuses.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    buffer = ctypes.create_string_buffer(code, len(code))

    class Fprog(ctypes.Structure):
        _fields_ = [("length", ctypes.c_ushort), ("code", ctypes.c_void_p)]

    prog = Fprog(len(code) // 8, ctypes.cast(buffer, ctypes.c_void_p))
    if libc.prctl(38, 1, 0, 0, 0) or libc.prctl(22, 2, ctypes.byref(prog), 0, 0):  # no new privileges; seccomp
        raise OSError(ctypes.get_errno(), "seccomp filter refused")
