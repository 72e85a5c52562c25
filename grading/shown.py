"""What of this machine's disk a sandbox sees: the interpreter, its packages, compiled kernels; never the kit itself."""

import hashlib
import os
import sys
import sysconfig
from pathlib import Path

from dualnav_lite.config import UnusableInput

CONDA = "envs/*/lib/python3*/*-packages"  # other environments, which lie below the base interpreter's folder
DEVICES = ["/dev/null", "/dev/zero", "/dev/urandom", "/dev/random"]


def system_folders() -> list[str]:
    """Folders that an interpreter and its packages need, seen at their own places; of a link where it leads as well."""
    wanted = ["/usr", "/lib", "/lib64", "/lib32", "/bin", "/etc/ld.so.cache"]
    wanted += [place for prefix in (sys.base_prefix, sys.prefix) for place in (prefix, os.path.realpath(prefix))]
    kept: list[str] = []
    for path in sorted(set(wanted), key=len):
        inside = any(Path(path).is_relative_to(other) and not os.path.islink(other) for other in kept)
        if os.path.lexists(path) and not inside:
            kept.append(path)
    return kept


def hidden_copies() -> list[str]:
    """Installed copies of the kit, of this interpreter or another one that is seen; they hold what is asked."""
    folders = {Path(sysconfig.get_path("purelib")), Path(sysconfig.get_path("platlib"))}
    for root in system_folders():
        for pattern in ("lib*/python3*/*-packages", "local/lib*/python3*/*-packages", "python3*/*-packages", CONDA):
            folders.update(Path(root).glob(pattern))
    found = {str(folder.resolve() / name) for folder in folders for name in ("dualnav_lite", "grading")}
    return sorted(path for path in found if os.path.isdir(path))


def refuse_shown(*paths: Path) -> None:
    """Nothing of the grader's may lie where submissions can read.

    Raises:
        UnusableInput: one of the paths lies in a folder that every sandbox shows.
    """
    for path in paths:
        for folder in system_folders():
            if os.path.isdir(folder) and path.resolve().is_relative_to(Path(folder).resolve()):
                raise UnusableInput(f"{path}: lies in {folder}, which submissions can read; move it elsewhere")


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
