"""What a sandbox is started for, and how much it may use."""

from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class Limits:
    """What one sandbox may use."""

    memory_mb: int = 2500  # of all its processes and files together, enforced by the watchdog
    address_space_mb: int = 12_000  # of one process; torch maps far more than it touches
    processes: int = 160  # and threads
    open_files: int = 512  # of one process
    descriptors: int = 2_000  # of all: each may hold memory in the kernel, such as the buffer of a socket
    file_mb: int = 64
    disk_mb: int = 256
    files: int = 20_000
    start_s: float = 60.0  # until the first hello: start of papermill and the kernel
    cells_s: float = 20.0  # from there until all cells have run, imports too; the reference needs 2 s


@dataclass
class Job:
    """What a sandbox is started for.

    Attributes:
        packages: folder with the masked package; read-only inside.
        brought: files by the name they get in the grader's folder inside.
        program: file of the grader's folder to run in place of the notebook.
        environment: further variables.
        kernels: compiled kernels of the package, copied in.
        limits: see `Limits`.
    """

    packages: Path | None = None
    brought: dict[str, bytes] = field(default_factory=dict)
    program: str = ""
    environment: dict[str, str] = field(default_factory=dict)
    kernels: Path | None = None
    limits: Limits = field(default_factory=Limits)


class SandboxError(RuntimeError):
    """The sandbox did not start; whoever was to be graded stays ungraded."""
