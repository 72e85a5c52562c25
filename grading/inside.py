"""First program in a sandbox: gives up what is left of its rights, then runs the notebook or a probe.

It is started as a file by an isolated interpreter (`-I`), next to copies of the modules that `sandbox.BROUGHT` names.
Nothing that it or anything after it prints is read as a verdict.
"""

import json
import os
import resource
import runpy
import shutil
import sys
from pathlib import Path


def give_up_root(uid: int) -> None:
    """Become a user whom nobody else is, without groups."""
    os.setgroups([])
    os.setresgid(uid, uid, uid)
    os.setresuid(uid, uid, uid)


def give_up_capabilities() -> None:
    """Keep none, and no way to get one back; a root without them owns its files and nothing else."""
    import ctypes

    libc = ctypes.CDLL(None, use_errno=True)
    for capability in range(64):
        if libc.prctl(24, capability, 0, 0, 0):  # out of the bounding set; fails past the last one
            break
    header = (ctypes.c_uint32 * 2)(0x20080522, 0)
    if libc.capset(header, (ctypes.c_uint32 * 6)()):
        raise OSError(ctypes.get_errno(), "capabilities cannot be given up")


def limit(limits: dict) -> None:
    """Hard limits, by the names of `resource`."""
    for name, value in limits.items():
        which = getattr(resource, f"RLIMIT_{name}")
        hard = resource.getrlimit(which)[1]
        value = value if hard == resource.RLIM_INFINITY else min(value, hard)
        resource.setrlimit(which, (value, value))


def run_notebook(job: dict) -> None:
    """papermill over the rebuilt notebook; kernel and papermill speak over files, not over the network."""
    from jupyter_client.manager import AsyncKernelManager
    from papermill.execute import execute_notebook

    class FileManager(AsyncKernelManager):
        """A kernel on unix sockets in the work folder."""

        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            self.transport, self.ip = "ipc", job["kernel"]

    execute_notebook(
        job["notebook"],
        job["executed"],
        kernel_name="python3",
        language="python",
        progress_bar=False,
        allow_errors=True,
        execution_timeout=None,  # the wall clock is outside
        start_timeout=job["start_s"],
        kernel_manager_class=FileManager,
        cwd=None,  # it is the work folder already, and where mounts do not protect nobody may leave it
    )


def main(path: str) -> None:
    """Do the job that a JSON file describes."""
    job = json.loads(Path(path).read_text(encoding="utf-8"))
    here = str(Path(__file__).parent)
    sys.path.append(here)
    if job["lifeline"]:
        import supervisor

        supervisor.supervise(job["lifeline"])
    if job["uid"]:
        give_up_root(job["uid"])
    if not job["capabilities"]:
        give_up_capabilities()
    os.umask(0o077)
    limit(job["limits"])
    for name in ("", "home", "kernel"):
        os.makedirs(os.path.join(job["work"], name), exist_ok=True)
    os.chdir(job["work"])
    if job["kernels"]:
        shutil.copytree(job["kernels"], os.environ["NUMBA_CACHE_DIR"])
    if job["landlock"]:
        import landlock

        landlock.restrict(job["readable"], [job["work"]], job["devices"])
    if job["seccomp"]:
        import seccomp

        seccomp.apply(seccomp.program(mounts=not job["landlock"]))
    os.write(1, b"grading: rights given up, starting\n")
    if job["program"]:
        if job["packages"]:
            sys.path.insert(0, job["packages"])
        runpy.run_path(os.path.join(here, job["program"]), run_name="__main__")
    else:
        run_notebook(job)


if __name__ == "__main__":
    main(sys.argv[1])
