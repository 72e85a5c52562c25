"""Things on this machine that no submission may reach; afterwards they tell what was reached."""

import contextlib
import ctypes
import os
import secrets
import selectors
import shutil
import socket
import subprocess
import tempfile
import threading
import time
from pathlib import Path
from typing import cast

CHILD_SUBREAPER = 36  # PR_SET_CHILD_SUBREAPER


class Canaries:
    """Files, sockets, a process and a secret in the environment; a `with` block puts them up and takes them away.

    Args:
        room: folder of all submissions; out: folder of results; repository: the kit's own folder.
    """

    def __init__(self, room: Path, out: Path, repository: Path):
        self._room, self._out, self._repository = room, out, repository
        self._stack = contextlib.ExitStack()
        self._heard: list[str] = []
        self._selector = selectors.DefaultSelector()

    def __enter__(self) -> "Canaries":
        self._children = _children()
        ctypes.CDLL(None).prctl(CHILD_SUBREAPER, 1, 0, 0, 0)  # what a sandbox leaves running becomes our child
        folder = Path(tempfile.mkdtemp(prefix="dualnav-canaries-"))
        self._stack.callback(shutil.rmtree, folder, ignore_errors=True)
        folder.chmod(0o755)
        self._secret, name = secrets.token_hex(16), f"dualnav-canary-{secrets.token_hex(8)}"
        os.environ["DUALNAV_CANARY"] = self._secret
        self._stack.callback(os.environ.pop, "DUALNAV_CANARY", None)
        self._open, self._key, self._home = folder / "file", folder / "key", folder / "home"
        for path, mode in ((self._open, 0o666), (self._key, 0o600), (self._home, 0o644)):
            path.write_text(self._secret, encoding="utf-8")
            path.chmod(mode)
        self._shared = folder / "shared"
        self._shared.mkdir()
        self._shared.chmod(0o777)
        sockets = folder / "sockets"
        sockets.mkdir()
        sockets.chmod(0o755)
        tcp = self._listen("tcp", socket.AF_INET, socket.SOCK_STREAM, ("127.0.0.1", 0))
        udp = self._listen("udp", socket.AF_INET, socket.SOCK_DGRAM, ("127.0.0.1", 0))
        self._listen("abstract", socket.AF_UNIX, socket.SOCK_STREAM, "\0" + name)
        for file, kind in (("c", socket.SOCK_STREAM), ("d", socket.SOCK_DGRAM)):
            self._listen(f"path {file}", socket.AF_UNIX, kind, str(sockets / file))
            (sockets / file).chmod(0o666)
        self._process = subprocess.Popen(["sleep", "100000"])
        self._stack.callback(self._process.wait)
        self._stack.callback(self._process.kill)
        self._before = self._state()
        self._ends, end = os.pipe()
        self._selector.register(self._ends, selectors.EVENT_READ, "end")
        listener = threading.Thread(target=self._hear, daemon=True)
        listener.start()
        self._stack.callback(os.close, end)
        self._stack.callback(listener.join, 10)
        self._stack.callback(os.write, end, b"x")  # closing tells nothing while a worker holds a copy
        self.places = {
            "FILE": str(self._open),
            "FOLDER": str(self._shared),
            "KEY": str(self._key),
            "HOME": str(self._home),
            "SOCKET": str(sockets / "c"),
            "DATAGRAM": str(sockets / "d"),
            "TCP": str(tcp),
            "UDP": str(udp),
            "ABSTRACT": name,
            "PID": str(self._process.pid),
            "SECRET": self._secret,
            "CLASS": str(self._room),
            "OUT": str(self._out),
            "REPOSITORY": str(self._repository),
        }
        return self

    def __exit__(self, *_) -> None:
        self._stack.close()
        ctypes.CDLL(None).prctl(CHILD_SUBREAPER, 0, 0, 0, 0)
        for pid in _children() - self._children:  # adopted and ended
            with contextlib.suppress(OSError):
                os.waitpid(pid, os.WNOHANG)

    def _listen(self, name: str, family: int, kind: int, address) -> int:
        """A socket that notes who comes; its port where it has one."""
        listener = self._stack.enter_context(socket.socket(family, kind))
        listener.bind(address)
        if kind == socket.SOCK_STREAM:
            listener.listen(8)
        listener.setblocking(False)
        self._selector.register(listener, selectors.EVENT_READ, name)
        return listener.getsockname()[1] if family == socket.AF_INET else 0

    def _hear(self) -> None:
        while True:
            for key, _ in self._selector.select():
                if key.data == "end":
                    return
                self._heard.append(key.data)
                listener = cast(socket.socket, key.fileobj)
                with contextlib.suppress(OSError):
                    if listener.type == socket.SOCK_STREAM:
                        listener.accept()[0].close()
                    else:
                        listener.recv(99)

    def _state(self) -> dict:
        """All that can be read off, for a comparison."""
        found: dict = {}
        for path in (self._open, self._key, self._home):
            status = path.lstat()
            found[path.name] = (
                path.read_bytes(), status.st_mode, status.st_uid, status.st_mtime_ns, status.st_nlink,
                os.listxattr(path),
            )  # fmt: skip
        status = self._shared.stat()
        found["shared"] = os.listdir(self._shared), status.st_mode, status.st_uid, status.st_mtime_ns
        pid = self._process.pid
        with open(f"/proc/{pid}/stat", encoding="utf-8") as file:
            found["process"] = file.read().split()[2]
        found["priority"] = os.getpriority(os.PRIO_PROCESS, pid), os.sched_getscheduler(pid)
        found["cores"] = sorted(os.sched_getaffinity(pid))
        places = [Path(place) / "dualnav-attack" for place in ("/tmp", "/dev/shm", "/var/tmp")]
        found["left"] = [str(path) for path in places if path.exists()]
        return found

    def _left_running(self, seconds: float = 10.0) -> list[int]:
        """Processes that live on although their sandbox has been closed; dying may take a moment."""
        deadline = time.monotonic() + seconds
        while True:
            left = [pid for pid in sorted(_children() - self._children - {self._process.pid}) if _runs(pid)]
            if not left or time.monotonic() > deadline:
                return left
            time.sleep(0.05)

    def touched(self) -> list[str]:
        """What was reached; empty where nothing was."""
        now = self._state()
        found = [name for name in now if now[name] != self._before[name] and not _is_same_state(name, now[name])]
        found += sorted({f"socket {name}" for name in self._heard})
        found += [f"left running: {pid}" for pid in self._left_running()]
        for path in self._out.rglob("*"):
            if path.is_file() and (b"LEAKED" in (content := path.read_bytes()) or b"<script>" in content):
                found.append(f"told in {path.name}")
        return found


def _is_same_state(name: str, value) -> bool:
    """A process sleeps or is just about to; anything else means that somebody stopped it."""
    return name == "process" and value in "SDR"


def _children() -> set[int]:
    """Processes whose parent we are, also by adoption."""
    found: set[int] = set()
    for thread in os.listdir("/proc/self/task"):
        with contextlib.suppress(OSError), open(f"/proc/self/task/{thread}/children", encoding="utf-8") as file:
            found.update(int(pid) for pid in file.read().split())
    return found


def _runs(pid: int) -> bool:
    """Whether a process is alive."""
    with contextlib.suppress(OSError), open(f"/proc/{pid}/stat", encoding="utf-8") as file:
        return file.read().rpartition(")")[2].split()[0] != "Z"
    return False
