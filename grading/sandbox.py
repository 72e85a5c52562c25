"""A place to run code of others: bubblewrap (tier A), Landlock (tier B), or none (refused unless it is asked for).

Started by root, the mounts are made by root and the program then becomes a user of its own without capabilities, so
that limits on processes hold and nothing in root's folders has to be opened to others. Started by anybody else, it gets
a user namespace. In both cases the seccomp filter, hard limits and a watchdog apply.
"""

import contextlib
import functools
import hashlib
import json
import os
import shutil
import signal
import socket
import stat
import subprocess
import sys
import sysconfig
import tempfile
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

from dualnav_lite.config import UnusableInput
from grading import landlock, seccomp
from grading.watchdog import Watchdog
from grading.wire import ClosedError, Connection, DeadlineError, ProtocolError

HERE = Path(__file__).resolve().parent
BROUGHT = ("inside.py", "landlock.py", "seccomp.py", "wire.py", "serve.py", "adapters.py", "probe_inside.py")
PREFIX = (
    "dualnav-grading-"  # of temporary folders; the process that made one follows, so that `sweep` knows whose it is
)
STARTED = b"grading: rights given up, starting\n"  # printed by `inside.py` before anything of others runs
DEVICES = ["/dev/null", "/dev/zero", "/dev/urandom", "/dev/random"]
TIERS = {
    "A": "bubblewrap: private namespaces, read-only system, seccomp, limits",
    "B": "Landlock and seccomp: no process namespace, no hard cap on the disk, path sockets stay reachable",
    "UNSANDBOXED": "none: code of others runs with your rights",
}


@dataclass(frozen=True)
class Limits:
    """What one sandbox may use."""

    memory_mb: int = 2500  # of all its processes and files together, enforced by the watchdog
    address_space_mb: int = 12_000  # of one process; torch maps far more than it touches
    processes: int = 160  # and threads
    open_files: int = 512
    file_mb: int = 64
    disk_mb: int = 256
    files: int = 20_000
    start_s: float = 60.0  # until the hello: start of the kernel, imports and the student's own cells


@dataclass
class Job:
    """What a sandbox is started for.

    Attributes:
        packages: folder with the masked package; read-only inside.
        brought: files by the name they get in the grader's folder inside.
        program: file of the grader's folder to run in place of the notebook.
        environment: further variables.
    """

    packages: Path | None = None
    brought: dict[str, bytes] = field(default_factory=dict)
    program: str = ""
    environment: dict[str, str] = field(default_factory=dict)
    kernels: Path | None = None
    limits: Limits = field(default_factory=Limits)


class SandboxError(RuntimeError):
    """The sandbox did not start; whoever was to be graded stays ungraded."""


def is_root() -> bool:
    """Whether this process may become anybody."""
    return os.geteuid() == 0


@functools.lru_cache
def bwrap_works() -> str:
    """Empty where bubblewrap can do all of tier A here, else one line that says why not."""
    if sys.platform != "linux":
        return "only Linux has it"
    tool = shutil.which("bwrap")
    if tool is None:
        return "bubblewrap is not installed (Debian, Ubuntu: apt install bubblewrap)"
    if not seccomp.is_supported():
        return "no seccomp filter for this processor"
    try:
        done = subprocess.run(
            [tool, *_isolation(), "--ro-bind", "/", "/", "--proc", "/proc", "true"], capture_output=True, timeout=20
        )
    except (OSError, subprocess.TimeoutExpired):
        return "bubblewrap does not start"
    if done.returncode == 0:
        return ""
    return "namespaces are denied (Ubuntu 24.04: sudo sysctl -w kernel.apparmor_restrict_unprivileged_userns=0)"


def landlock_works() -> str:
    """Empty where tier B can hold, else one line that says why not."""
    if sys.platform != "linux":
        return "only Linux has it"
    if not seccomp.is_supported():
        return "no seccomp filter for this processor"
    if landlock.abi() < landlock.NEEDED_ABI:
        return f"Landlock here is version {landlock.abi()}, needed is {landlock.NEEDED_ABI} (Linux 6.12)"
    return ""


def choose_tier(unsafe: bool = False, wanted: str = "") -> str:
    """The best tier that works here.

    Raises:
        UnusableInput: none does and `unsafe` was not asked for.
    """
    problems = {"A": bwrap_works(), "B": landlock_works()}
    for tier in [wanted] if wanted else ["A", "B"]:
        if tier not in problems:
            raise UnusableInput(f"no sandbox tier '{tier}'; known: A, B")
        if not problems[tier]:
            return tier
    if unsafe:
        return "UNSANDBOXED"
    told = "; ".join(f"tier {tier}: {problems[tier]}" for tier in ([wanted] if wanted else problems))
    raise UnusableInput(f"no sandbox works here, so nothing is graded ({told})")


def _isolation() -> list[str]:
    """bubblewrap's options that make the namespaces."""
    options = ["--unshare-pid", "--unshare-net", "--unshare-ipc", "--unshare-uts", "--unshare-cgroup-try"]
    options += ["--hostname", "sandbox", "--new-session", "--die-with-parent", "--cap-drop", "ALL"]
    if is_root():  # `inside.py` becomes somebody else, and has no capability left afterwards
        return [*options, "--cap-add", "CAP_SETUID", "--cap-add", "CAP_SETGID"]
    return [*options, "--unshare-user", "--disable-userns", "--uid", "1000", "--gid", "1000"]


def _system() -> list[str]:
    """Folders that an interpreter and its packages need, seen at their own places."""
    wanted = ["/usr", "/lib", "/lib64", "/lib32", "/bin", "/etc/ld.so.cache", sys.base_prefix, sys.prefix]
    kept: list[str] = []
    for path in sorted(set(wanted), key=len):
        inside = any(Path(path).is_relative_to(other) and not os.path.islink(other) for other in kept)
        if os.path.lexists(path) and not inside:
            kept.append(path)
    return kept


def _hidden() -> list[str]:
    """Copies of the kit in site-packages, which must not be seen."""
    folders = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
    found = [os.path.join(folder, name) for folder in folders for name in ("dualnav_lite", "grading", "tests")]
    return [path for path in found if os.path.isdir(path)]


def kernel_cache(package: Path) -> Path | None:
    """Folder with compiled kernels of a package, where there is one."""
    beside = package / "kernels" / "__pycache__"
    elsewhere = os.environ.get("NUMBA_CACHE_DIR")
    if elsewhere:
        beside = Path(elsewhere) / numba_folder(str(package / "kernels"))
    return beside if any(beside.glob("*.nbi")) else None


def numba_folder(path: str) -> str:
    """Name of the folder below NUMBA_CACHE_DIR where numba keeps the kernels of the files in a folder."""
    return f"{os.path.basename(path)}_{hashlib.sha1(path.encode()).hexdigest()}"


def _memory_file(content: bytes) -> int:
    """An unnamed file that a child may read from its start."""
    handle = os.memfd_create("job", 0)
    with os.fdopen(os.dup(handle), "wb") as file:
        file.write(content)
    os.lseek(handle, 0, os.SEEK_SET)
    return handle


class Sandbox:
    """A running sandbox; use it in a `with` block, which leaves nothing behind.

    Args:
        job: what to run.
        tier: from `choose_tier`.

    Raises:
        SandboxError: it did not start.
    """

    def __init__(self, job: Job, tier: str):
        self._job, self._tier = job, tier
        self.folder = Path(tempfile.mkdtemp(prefix=f"{PREFIX}{os.getpid()}-"))
        self.output = b""  # first bytes of what it printed; for people who look for a mistake in the kit, never scored
        self._process: subprocess.Popen | None = None
        self._watchdog: Watchdog | None = None
        self._listener: socket.socket | None = None
        try:
            self._start()
        except BaseException as error:
            self.close()
            if isinstance(error, OSError | subprocess.SubprocessError):
                raise SandboxError(f"the sandbox does not start: {type(error).__name__}") from None
            raise

    # What is where: outside a folder of our own, inside /grader.

    def _start(self) -> None:
        job, limits, here = self._job, self._job.limits, self.folder
        for name in ("grader", "socket"):
            (here / name).mkdir()
            os.chmod(here / name, 0o755)
        shown = Path("/grader") if self._tier == "A" else here / "grader"
        work = Path("/tmp/work") if self._tier == "A" else here / "work"
        packages = shown / "packages" if self._tier == "A" else job.packages
        sockets = shown / "socket" if self._tier == "A" else here / "socket"
        for name in BROUGHT:
            self._bring(name, (HERE / name).read_bytes())
        for name, content in job.brought.items():
            self._bring(name, content)
        uid = 1_900_000_000 + os.getpid() if is_root() and self._tier == "A" else 0
        kernels = here / "grader" / "kernels"
        if job.kernels and packages:
            kernels.mkdir()
            place = kernels / numba_folder(str(packages / "dualnav_lite" / "kernels"))
            shutil.copytree(job.kernels, place, ignore=lambda _, names: [n for n in names if ".nb" not in n])
            for path in [kernels, place, *place.iterdir()]:
                os.chmod(path, 0o755 if path.is_dir() else 0o644)
        environment = self._environment(work, packages, sockets, shown)
        megabyte = 1 << 20
        told = {
            "uid": uid,
            "work": str(work),
            "notebook": str(shown / "notebook.ipynb"),
            "executed": str(work / "executed.ipynb"),
            "start_s": int(limits.start_s),
            "program": job.program,
            "packages": str(packages) if packages else "",
            "kernels": str(shown / "kernels") if kernels.exists() else "",
            "capabilities": self._tier == "UNSANDBOXED",
            "landlock": self._tier == "B",
            "seccomp": self._tier == "B" or (self._tier == "A" and is_root()),
            "readable": [*_system(), str(shown), str(sockets), *([str(packages)] if packages else [])],
            "devices": DEVICES,
            "limits": {
                "CORE": 0,
                "AS": limits.address_space_mb * megabyte,
                "FSIZE": limits.file_mb * megabyte,
                "NOFILE": limits.open_files,
                "NPROC": limits.processes if uid else limits.processes + _own_tasks(),
                "MEMLOCK": 0,
                "MSGQUEUE": 0,
            },
        }
        self._bring("job.json", json.dumps(told).encode("utf-8"))
        self._listen()
        # `-I`: no PYTHON* variable, no user site, no folder of the script in the path.
        program = [sys.executable, "-I", "-B", str(shown / "inside.py"), str(shown / "job.json")]
        if self._tier == "A":
            self._start_bwrap(program, environment)
        else:
            self._start_plain(program, environment, work)
        os.set_blocking(self._process.stdout.fileno(), True)
        threading.Thread(target=self._drain, daemon=True).start()
        self._watchdog = Watchdog(self._first, limits, self._kill, work if self._tier != "A" else None, uid)
        self._watchdog.start()

    def _bring(self, name: str, content: bytes) -> None:
        path = self.folder / "grader" / name
        path.write_bytes(content)
        os.chmod(path, 0o644)

    def _environment(self, work: Path, packages: Path | None, sockets: Path, shown: Path) -> dict[str, str]:
        """Every variable that the program sees; nothing of the caller's comes along."""
        known = {
            "PATH": f"{sys.prefix}/bin:/usr/bin:/bin",
            "HOME": str(work / "home"),
            "TMPDIR": str(work),
            "LANG": "C.UTF-8",
            "PYTHONUTF8": "1",
            "PYTHONDONTWRITEBYTECODE": "1",
            "PYTHONHASHSEED": "0",
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
            "MKL_NUM_THREADS": "1",
            "MPLBACKEND": "agg",
            "NUMBA_CACHE_DIR": str(work / "kernels"),
            "JUPYTER_PLATFORM_DIRS": "1",
            "JUPYTER_RUNTIME_DIR": str(work / "kernel"),
            "GRADING_FOLDER": str(shown),
            "GRADING_EXECUTED": str(work / "executed.ipynb"),
            "GRADING_SOCKET": str(sockets / "scorer"),
            "GRADING_WEIGHTS": str(shown / "weights"),
        }
        if packages:
            known["PYTHONPATH"] = str(packages)
        return known | self._job.environment

    def _listen(self) -> None:
        """The socket that the scorer waits at; bound through a handle, since its path may be too long (108 bytes)."""
        self._listener = socket.socket(socket.AF_UNIX)
        handle = os.open(self.folder / "socket", os.O_PATH | os.O_DIRECTORY)
        try:
            self._listener.bind(f"/proc/self/fd/{handle}/scorer")
        finally:
            os.close(handle)
        os.chmod(self.folder / "socket" / "scorer", 0o666 if is_root() else 0o600)
        self._listener.listen(1)

    def _start_bwrap(self, program: list[str], environment: dict[str, str]) -> None:
        limits, megabyte = self._job.limits, 1 << 20
        options = [*_isolation(), "--proc", "/proc", "--dev", "/dev"]
        options += ["--perms", "1777", "--size", str(16 * megabyte), "--tmpfs", "/dev/shm"]
        # Before the interpreter's folders: a checkout may lie in /tmp itself.
        options += ["--perms", "1777", "--size", str(limits.disk_mb * megabyte), "--tmpfs", "/tmp"]
        for path in _system():
            for parent in reversed(Path(path).parents[:-1]):  # else bubblewrap makes them for root's eyes alone
                options += ["--perms", "0755", "--dir", str(parent)]
            if os.path.islink(path):
                options += ["--symlink", os.readlink(path), path]
            else:
                options += ["--ro-bind", path, path]
        for path in _hidden():
            options += ["--size", "4096", "--tmpfs", path, "--remount-ro", path]
        options += ["--ro-bind", str(self.folder / "grader"), "/grader"]
        if self._job.packages:  # the mount point must be there before the read-only mount
            (self.folder / "grader" / "packages").mkdir()
            options += ["--ro-bind", str(self._job.packages), "/grader/packages"]
        (self.folder / "grader" / "socket").mkdir()
        options += ["--ro-bind", str(self.folder / "socket"), "/grader/socket"]
        options += ["--remount-ro", "/dev", "--remount-ro", "/", "--chdir", "/tmp"]
        handles = []
        if not is_root():  # with root the filter is set after the change of user
            handles.append(_memory_file(seccomp.program()))
            options += ["--seccomp", str(handles[-1])]
        told, tell = os.pipe()
        options += ["--info-fd", str(tell)]
        # As a file and not as arguments, which everybody inside could read in /proc/1/cmdline.
        handles.append(_memory_file(b"".join(option.encode() + b"\0" for option in options)))
        try:
            self._process = subprocess.Popen(
                [shutil.which("bwrap"), "--args", str(handles[-1]), "--", *program],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                env=environment,
                pass_fds=[*handles, tell],
                start_new_session=True,
            )
        finally:
            for handle in (*handles, tell):
                os.close(handle)
        with os.fdopen(told, "rb") as file:
            answer = file.read(4096)
        if not answer:
            self._process.wait(timeout=10)
            raise SandboxError("bubblewrap does not start: " + _one_line(self._process.stdout.read(2000)))
        self._first = json.loads(answer)["child-pid"]

    def _start_plain(self, program: list[str], environment: dict[str, str], work: Path) -> None:
        work.mkdir()
        _adopt_orphans()
        self._process = subprocess.Popen(
            program,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=environment,
            start_new_session=True,
        )
        self._first = self._process.pid

    def _drain(self) -> None:
        """Take what it prints, keep the first of it and throw away the rest, so that it never waits for us."""
        stream = self._process.stdout
        with contextlib.suppress(OSError, ValueError):
            while piece := os.read(stream.fileno(), 1 << 16):
                self.output = (self.output + piece)[:20_000]

    # While it runs.

    @property
    def killed_for(self) -> str:
        """What the watchdog killed it for; empty where it did not."""
        return self._watchdog.reason if self._watchdog else ""

    def accept(self, seconds: float, most_payload: int) -> tuple[Connection, dict]:
        """The one connection, once its hello is there, and the arrays of the hello.

        Raises:
            DeadlineError: no hello in time; ClosedError: it ended before.
            ProtocolError: something else came than a hello.
        """
        deadline = time.monotonic() + seconds
        while True:
            self._listener.settimeout(0.1)
            try:
                connected, _ = self._listener.accept()
                break
            except TimeoutError:
                if self._process.poll() is not None:
                    raise ClosedError("ended before the last cell") from None
                if time.monotonic() > deadline:
                    raise DeadlineError("no hello in time") from None
        self._listener.close()  # one connection: nobody else gets an answer
        connection = Connection(connected, most_payload)
        kind, number, word, arrays = connection.receive(deadline)
        if (kind, number, word) != ("hello", 0, ""):
            raise ProtocolError("not a hello")
        return connection, arrays

    def ran_cells(self) -> bool:
        """Whether the program got as far as running a notebook or file of others, by the trusted start's own mark."""
        return STARTED in self.output

    def wait(self, seconds: float) -> int | None:
        """Exit status, None where it still runs after so long."""
        try:
            return self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            return None

    def _kill(self) -> None:
        """End every process in it, at once."""
        if self._tier == "A":
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._first, signal.SIGKILL)  # the first process of its namespace takes all others along
        else:
            self._watchdog.kill_all() if self._watchdog else self._process.kill()
        with contextlib.suppress(ProcessLookupError):
            self._process.kill()

    def close(self) -> None:
        """End it and take its folder away."""
        if self._process:
            if self._watchdog:
                self._watchdog.stop()
            with contextlib.suppress(AttributeError):
                self._kill()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(10)
            self._process.stdout.close()
        if self._listener:
            self._listener.close()
        for path in [self.folder, *(p for p in self.folder.rglob("*") if p.is_dir() and not p.is_symlink())]:
            with contextlib.suppress(OSError):
                os.chmod(path, stat.S_IRWXU)
        shutil.rmtree(self.folder, ignore_errors=True)

    def __enter__(self) -> "Sandbox":
        return self

    def __exit__(self, *_) -> None:
        self.close()


def _one_line(text: bytes) -> str:
    return " ".join(text.decode("utf-8", "replace").split())[:300]


def _own_tasks() -> int:
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
    import ctypes

    ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)
