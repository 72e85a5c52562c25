"""Which sandbox works here: bubblewrap (tier A), Landlock (tier B), or none (refused unless it is asked for)."""

import functools
import shutil
import subprocess
import sys

from dualnav_lite.config import UnusableInput
from grading import bubblewrap, landlock, seccomp
from grading.shown import hidden_copies

TIERS = {
    "A": "bubblewrap: private namespaces, read-only system, seccomp, limits",
    "B": "Landlock and seccomp: no process namespace, no hard cap on the disk, files can be seen to exist",
    "UNSANDBOXED": "none: code of others runs with your rights",
}


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
    trial = [tool, *bubblewrap.isolation(), "--ro-bind", "/", "/", "--proc", "/proc", "true"]
    try:
        done = subprocess.run(trial, capture_output=True, timeout=20)
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
    if hidden_copies():
        return f"an installed copy of the kit cannot be hidden ({hidden_copies()[0]}); uninstall it"
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
