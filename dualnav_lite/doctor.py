"""What works on this machine, a line each; nothing is changed."""

import os
import platform
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib import metadata
from typing import NamedTuple

import numpy as np

from dualnav_lite.config import ROOT, UnusableInput
from dualnav_lite.env import DynamicNavVectorEnv
from dualnav_lite.figures import chinese_font

LESSON_SPEED = 4_700  # control steps/s of the core on which the CPU seconds in the lessons' heads were measured


class Finding(NamedTuple):
    """One line of the page."""

    subject: str
    text: str
    is_problem: bool = False


def _pinned() -> dict[str, str]:
    """Version that requirements.txt asks for, by package."""
    lines = (ROOT / "requirements.txt").read_text(encoding="utf-8").splitlines()
    pins = [line.split("#")[0].strip().split("==") for line in lines if "==" in line.split("#")[0]]
    return {name: version for name, version in pins}


def _packages() -> Finding:
    """Whether every pinned package is installed in its pinned version."""
    wrong = []
    for name, wanted in _pinned().items():
        try:
            found = metadata.version(name).split("+")[0]
        except metadata.PackageNotFoundError:
            found = "missing"
        if found != wanted:
            wrong.append(f"{name} {found} instead of {wanted}")
    return Finding("packages", ", ".join(wrong) or f"{len(_pinned())} at their pinned versions", bool(wrong))


def _torch() -> Finding:
    """Which build of PyTorch is installed; the CPU build is enough."""
    try:
        return Finding("torch", metadata.version("torch"))
    except metadata.PackageNotFoundError:
        return Finding("torch", "missing", True)


def _sandbox() -> Finding:
    """Which sandbox can run code of others here."""
    tool = shutil.which("bwrap")
    if tool is None:
        return Finding("sandbox", "none: grading needs bubblewrap on Linux (apt install bubblewrap)")
    probe = [tool, "--ro-bind", "/", "/", "--unshare-all", "--die-with-parent", "true"]
    if subprocess.run(probe, capture_output=True, timeout=20, check=False).returncode == 0:
        return Finding("sandbox", "tier A: bubblewrap with user namespaces")
    hint = "on Ubuntu 24.04: sudo sysctl -w kernel.apparmor_restrict_unprivileged_userns=0"
    return Finding("sandbox", f"bubblewrap is here, but user namespaces are denied ({hint})")


def _fonts() -> Finding:
    """Whether figures can be labelled in Chinese."""
    try:
        return Finding("fonts", f"{chinese_font()}, for Chinese figures")
    except UnusableInput:
        return Finding("fonts", "no Chinese font, so no Chinese figures (Debian and Ubuntu: fonts-noto-cjk)")


def _browser() -> Finding:
    """Whether pages can be drawn for the browser tests."""
    names = ("chromium", "chromium-browser", "google-chrome", "chrome")
    found = [name for name in names if shutil.which(name)]
    return Finding("browser", found[0] if found else "no Chromium: the browser tests are skipped (apt: chromium)")


def control_speed(clock: Callable[[], float] = time.perf_counter) -> float:
    """Full control steps a second of eight worlds in one process, measured for a second.

    Args:
        clock: `time.process_time` leaves out what other programs take.
    """
    worlds = 8
    env = DynamicNavVectorEnv(worlds)
    env.reset(seed=0)
    actions = np.tile([0.3, 0.2], (worlds, 1))
    for _ in range(10):  # every kernel has been met by then
        env.step(actions)
    steps, start = 0, clock()
    while clock() - start < 1.0:
        env.step(actions)
        steps += worlds
    rate = steps / (clock() - start)
    env.close()
    return rate


def _speed() -> Finding:
    """This machine beside the one on which the lessons' seconds were measured."""
    here = control_speed()
    return Finding("speed", f"{here:,.0f} control steps/s on one core (lessons state seconds for {LESSON_SPEED:,})")


def findings() -> Iterator[Finding]:
    """Every finding, in the order in which a reader would ask."""
    yield Finding("python", f"{platform.python_version()} ({sys.platform}, {platform.machine()})")
    yield _packages()
    yield _torch()
    yield Finding("cores", f"{os.cpu_count()}")
    yield Finding("disk", f"{shutil.disk_usage(ROOT).free / 1e9:.0f} GB free")
    yield Finding("kernels", f"kept in {os.environ.get('NUMBA_CACHE_DIR', 'dualnav_lite/kernels/__pycache__')}")
    yield _sandbox()
    yield _fonts()
    yield _browser()
    yield _speed()
