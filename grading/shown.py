"""What of this machine's disk a sandbox sees: the interpreter, its packages, compiled kernels; never the kit itself."""

import hashlib
import os
import sys
import sysconfig
from pathlib import Path

DEVICES = ["/dev/null", "/dev/zero", "/dev/urandom", "/dev/random"]


def system_folders() -> list[str]:
    """Folders that an interpreter and its packages need, seen at their own places."""
    wanted = ["/usr", "/lib", "/lib64", "/lib32", "/bin", "/etc/ld.so.cache", sys.base_prefix, sys.prefix]
    kept: list[str] = []
    for path in sorted(set(wanted), key=len):
        inside = any(Path(path).is_relative_to(other) and not os.path.islink(other) for other in kept)
        if os.path.lexists(path) and not inside:
            kept.append(path)
    return kept


def hidden_copies() -> list[str]:
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
