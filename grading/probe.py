"""What a sandbox really denies here: tried, not read off from what is installed."""

import contextlib
import os
import socket
import tempfile
import uuid
from pathlib import Path

from grading.job import Job, Limits, SandboxError
from grading.sandbox import Sandbox
from grading.wire import ProtocolError


def probe(tier: str) -> dict[str, bool]:
    """Whether each trial of `probe_inside.py` was denied in a sandbox of this tier.

    Raises:
        SandboxError: it does not start, or the probe gives no answer.
    """
    name = f"dualnav-probe-{uuid.uuid4().hex}"
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="dualnav-probe-")))
        canary = folder / "canary"
        canary.write_text("nothing to see", encoding="utf-8")
        canary.chmod(0o644)
        folder.chmod(0o755)
        for address in ("\0" + name, str(folder / "socket")):
            listener = stack.enter_context(socket.socket(socket.AF_UNIX))
            listener.bind(address)
            listener.listen(1)
        (folder / "socket").chmod(0o666)
        told = {
            "PROBE_ABSTRACT": name,
            "PROBE_SOCKET": str(folder / "socket"),
            "PROBE_FILE": str(canary),
            "PROBE_PID": str(os.getpid()),
        }
        job = Job(program="probe_inside.py", environment=told, limits=Limits(start_s=60.0))
        os.environ["PROBE_CANARY"] = "the caller's environment"
        stack.callback(os.environ.pop, "PROBE_CANARY", None)
        sandbox = stack.enter_context(Sandbox(job, tier))
        try:
            connection, arrays = sandbox.accept(job.limits.start_s, 1 << 20)
        except ProtocolError as error:
            last = sandbox.output.decode("utf-8", "replace").strip().splitlines()[-1:]
            raise SandboxError(f"the probe gives no answer ({error}) {' '.join(last)[:200]}") from None
        connection.close()
        return {trial: int(value) == 1 for trial, value in arrays.items()}


def leaks(found: dict[str, bool]) -> list[str]:
    """Trials that went through although every tier promises that they do not."""
    return sorted(name for name, denied in found.items() if not denied)
