"""Attacks on the grader: each ends as the table says, and nothing outside the sandbox notices any of them."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from dualnav_lite.config import UnusableInput
from grading.attacks.graded import run_all
from grading.attacks.table import read_table
from grading.probe import leaks, probe
from grading.room import PACKAGE
from grading.shown import kernel_cache, numba_folder
from grading.tiers import choose_tier

ROOT = Path(__file__).resolve().parents[1]
TABLE = read_table()
# One of each kind, none that waits for a deadline.
FAST = (
    "kill_everybody",
    "daemon",
    "hidden_files",
    "network",
    "path_sockets",
    "host_writes",
    "kernel_calls",
    "patched_numpy",
    "library_solution",
    "told_by_exceptions",
    "pages_and_formulas",
    "chosen_reason",
    "linked_notebook",
    "control_folder_of_moodle",
)
FAST_IN_TIER_B = ("daemon", "path_sockets", "host_writes", "hidden_files")
NOBODY = 65534


def works(tier: str) -> None:
    """Go on where a tier works; in CI fail, and elsewhere skip, where it does not."""
    try:
        choose_tier(wanted=tier)
    except UnusableInput as error:
        if os.environ.get("DUALNAV_NO_SKIPS"):
            raise
        pytest.skip(f"nothing can be graded here: {error}")


def test_every_line_of_the_list_has_an_attack():
    """The list is the one of the grading's design, item by item, as the table quotes it."""
    lines = {attack.line for attack in TABLE.values()}
    assert len(TABLE) >= 70
    assert len([line for line in lines if not line.startswith("(ours)")]) >= 24
    assert {*FAST, *FAST_IN_TIER_B} <= set(TABLE)


@pytest.mark.parametrize("tier", ["A", "B"])
def test_a_probe_finds_every_door_shut(tier):
    works(tier)
    found = probe(tier)
    assert len(found) >= 29
    assert leaks(found) == []


@pytest.mark.parametrize(("tier", "names"), [("A", FAST), ("B", FAST_IN_TIER_B)])
def test_a_dozen_attacks_end_as_they_should(tier, names):
    works(tier)
    endings, wrong = run_all([TABLE[name] for name in names], tier)
    assert {one.attack.name: one.found for one in endings if not one.right} == {}
    assert wrong == []


@pytest.mark.slow
def test_all_attacks_end_as_they_should():
    works("A")
    endings, wrong = run_all(list(TABLE.values()), "A", jobs=2)
    assert {one.attack.name: one.found for one in endings if not one.right} == {}
    assert wrong == []
    assert len(endings) == len(TABLE)


@pytest.mark.slow
def test_whoever_takes_too_much_harms_nobody_who_is_graded_beside_him():
    works("A")
    names = ("fork_bomb", "hidden_files", "memory_bomb_thirty", "network", "output_flood", "patched_numpy")
    endings, wrong = run_all([TABLE[name] for name in names], "A", jobs=2)
    assert {one.attack.name: one.found for one in endings if not one.right} == {}
    assert wrong == []


@pytest.mark.slow
def test_all_attacks_that_a_tier_matters_for_end_as_they_should_in_tier_b():
    works("B")
    endings, wrong = run_all([one for one in TABLE.values() if one.group in ("resources", "doors")], "B", jobs=2)
    assert {one.attack.name: one.found for one in endings if not one.right} == {}
    assert wrong == []


def as_somebody_else(command: list[str], home: Path) -> list[str]:
    """A command run by a normal user, where root runs the tests; closed folders on the way are opened for it alone."""
    needed = sorted({str(ROOT), sys.prefix, sys.base_prefix})
    closed = {
        str(parent) for path in needed for parent in Path(path).parents if not parent.stat().st_mode & 0o001
    }  # such as /root, where an interpreter may lie
    mounts = ["--dev-bind", "/", "/"]
    for folder in sorted(closed):
        mounts += ["--perms", "0755", "--tmpfs", folder]
    for path in needed:
        if any(Path(path).is_relative_to(folder) for folder in closed):
            for parent in reversed(Path(path).parents[:-1]):  # else bubblewrap makes them for root's eyes alone
                mounts += ["--perms", "0755", "--dir", str(parent)]
            mounts += ["--ro-bind", path, path]
    become = ["setpriv", "--reuid", str(NOBODY), "--regid", str(NOBODY), "--clear-groups", "--no-new-privs"]
    return ["bwrap", *mounts, *become, "env", f"HOME={home}", f"TMPDIR={home}", *command]


def attacks_of_a_normal_user(tier: str, names: tuple[str, ...], home: Path) -> dict:
    """What `python -m grading.attacks --json` tells somebody who is not root."""
    works(tier)
    if os.geteuid() != 0:
        pytest.skip("the tests are run by a normal user already")
    for path in (home, *home.parents):
        if path.name.startswith("pytest") or path == home:
            path.chmod(0o755)
    variables = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"}
    kernels = kernel_cache(PACKAGE)
    if kernels:  # numba takes compiled kernels only from where it could write; compiling them anew takes a minute
        shutil.copytree(kernels, home / "numba" / numba_folder(str(PACKAGE / "kernels")))
        variables["NUMBA_CACHE_DIR"] = str(home / "numba")
    for path in (home, *home.rglob("*")):
        os.chown(path, NOBODY, NOBODY)
    command = [sys.executable, "-m", "grading.attacks", *names, "--tier", tier, "--json"]
    done = subprocess.run(
        as_somebody_else(command, home), cwd=ROOT, env=variables, capture_output=True, text=True, timeout=1500
    )
    assert done.stdout, done.stderr[-2000:]
    return json.loads(done.stdout)


@pytest.mark.slow
def test_a_normal_user_has_a_sandbox_as_well(tmp_path):
    told = attacks_of_a_normal_user("A", ("kernel_calls",), tmp_path)
    assert told["wrong"] == []
    assert all(right for right, _ in told["endings"].values())


@pytest.mark.slow
def test_attacks_of_a_normal_user_that_leave_the_kernel_end_as_they_should(tmp_path):
    names = tuple(name for name, one in TABLE.items() if one.group == "doors")
    told = attacks_of_a_normal_user("A", names, tmp_path)
    assert {name: found for name, (right, found) in told["endings"].items() if not right} == {}
    assert told["wrong"] == []
    assert set(told["endings"]) == set(names)
