"""A place to run code of others, from its start to the removal of all that it left.

What it is made of stands in `bubblewrap` (tier A) and `plain` (tier B); the seccomp filter, hard limits and a watchdog
apply in both.
"""

import contextlib
import itertools
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from grading import bubblewrap, plain
from grading.bubblewrap import MEGABYTE, is_root
from grading.cores import on_a_core, take_core
from grading.folders import own_prefix
from grading.job import Job, SandboxError
from grading.shown import DEVICES, numba_folder, system_folders
from grading.watchdog import Watchdog
from grading.wire import ClosedError, Connection, DeadlineError, ProtocolError

HERE = Path(__file__).resolve().parent
BROUGHT = (
    "inside.py",
    "supervisor.py",
    "landlock.py",
    "seccomp.py",
    "wire.py",
    "serve.py",
    *(f"adapters/{path.name}" for path in sorted((HERE / "adapters").glob("*.py"))),
    "probe_inside.py",
)
FIRST_USER, USERS_A_PROCESS = 2_000_300_000, 32  # above what directories of users and systemd give out
_USERS = itertools.count()


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
        self.folder = Path(tempfile.mkdtemp(prefix=own_prefix()))
        self.output = b""  # first bytes of what it printed; for people who look for a mistake in the kit, never scored
        self._process: subprocess.Popen | None = None
        self._watchdog: Watchdog | None = None
        self._listener: socket.socket | None = None
        self._lifeline: int | None = None
        self._slot, self._core = take_core()
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
        has_mounts = self._tier == "A"
        for name in ("grader", "socket" if has_mounts else "work"):
            (here / name).mkdir()
            os.chmod(here / name, 0o755)
        shown = Path("/grader") if has_mounts else here / "grader"
        work = Path("/tmp/work") if has_mounts else here / "work"
        packages = shown / "packages" if has_mounts else job.packages
        # Without mounts every address is a short name in the working folder: the filter refuses longer ones.
        endpoint = str(shown / "socket" / "scorer") if has_mounts else "s"
        self._listen(here / "socket" / "scorer" if has_mounts else work / "s")
        for name in BROUGHT:
            self._bring(name, (HERE / name).read_bytes())
        for name, content in job.brought.items():
            self._bring(name, content)
        uid = _next_user() if is_root() and has_mounts else 0
        kernels = here / "grader" / "kernels"
        if job.kernels and packages:
            kernels.mkdir()
            place = kernels / numba_folder(str(packages / "dualnav_lite" / "kernels"))
            shutil.copytree(job.kernels, place, ignore=lambda _, names: [n for n in names if ".nb" not in n])
            for path in [kernels, place, *place.iterdir()]:
                os.chmod(path, 0o755 if path.is_dir() else 0o644)
        environment = self._environment(work, packages, endpoint, shown)
        told: dict = {
            "uid": uid,
            "lifeline": 0,
            "work": str(work),
            "kernel": str(work / "kernel") if has_mounts else "k",
            "notebook": str(shown / "notebook.ipynb"),
            "executed": str(work / "executed.ipynb"),
            "start_s": int(limits.start_s),
            "program": job.program,
            "packages": str(packages) if packages else "",
            "kernels": str(shown / "kernels") if kernels.exists() else "",
            "capabilities": self._tier == "UNSANDBOXED",
            "landlock": self._tier == "B",
            "seccomp": self._tier != "UNSANDBOXED",
            "readable": [*system_folders(), str(shown), *([str(packages)] if packages else [])],
            "devices": DEVICES,
            "limits": {
                "CORE": 0,
                "AS": limits.address_space_mb * MEGABYTE,
                "FSIZE": limits.file_mb * MEGABYTE,
                "NOFILE": limits.open_files,
                "NPROC": limits.processes if uid else limits.processes + plain.own_tasks(),
                "MEMLOCK": 0,
                "MSGQUEUE": 0,
            },
        }
        if not has_mounts:
            told["lifeline"], self._lifeline = os.pipe()
        self._bring("job.json", json.dumps(told).encode("utf-8"))
        # `-I`: no PYTHON* variable, no user site, no folder of the script in the path.
        program = [sys.executable, "-I", "-B", str(shown / "inside.py"), str(shown / "job.json")]
        if has_mounts:
            options = [*bubblewrap.isolation(), *bubblewrap.mounts(here, job.packages, limits)]
            with on_a_core(self._slot, self._core):
                self._process, self._first = bubblewrap.start(program, environment, options)
        else:
            try:
                with on_a_core(self._slot, self._core):
                    self._process = plain.start(program, environment, told["lifeline"])
            finally:
                os.close(told["lifeline"])
            self._first = self._process.pid
        os.set_blocking(self._process.stdout.fileno(), True)
        threading.Thread(target=self._drain, daemon=True).start()
        self._watchdog = Watchdog(self._first, limits, self._kill, None if has_mounts else work, uid)
        self._watchdog.start()

    def _bring(self, name: str, content: bytes) -> None:
        path = self.folder / "grader" / name
        path.parent.mkdir(exist_ok=True)
        os.chmod(path.parent, 0o755)
        path.write_bytes(content)
        os.chmod(path, 0o644)

    def _environment(self, work: Path, packages: Path | None, endpoint: str, shown: Path) -> dict[str, str]:
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
            "GRADING_SOCKET": endpoint,
            "GRADING_WEIGHTS": str(shown / "weights"),
        }
        if packages:
            known["PYTHONPATH"] = str(packages)
        return known | self._job.environment

    def _listen(self, path: Path) -> None:
        """The socket that the scorer waits at; bound through a handle, since its path may be too long (108 bytes)."""
        self._listener = socket.socket(socket.AF_UNIX)
        handle = os.open(path.parent, os.O_PATH | os.O_DIRECTORY)
        try:
            self._listener.bind(f"/proc/self/fd/{handle}/{path.name}")
        finally:
            os.close(handle)
        os.chmod(path, 0o666 if is_root() else 0o600)
        self._listener.listen(1)

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
        elif self._watchdog:
            plain.kill(self._first, self._watchdog.members)
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
        if self._lifeline is not None:
            os.close(self._lifeline)
            self._lifeline = None
        if self._slot:
            self._slot.close()
        plain.remove(self.folder)

    def __enter__(self) -> "Sandbox":
        return self

    def __exit__(self, *_) -> None:
        self.close()


def _next_user() -> int:
    """A user id that no other sandbox has, whichever thread or process of root's starts it."""
    return FIRST_USER + os.getpid() * USERS_A_PROCESS + next(_USERS) % USERS_A_PROCESS
