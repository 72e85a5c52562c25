"""kit.py: sets up once, refuses a wrong Python in one line, works in any folder."""

import ast
import importlib.util
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest
from numba.core.caching import _CacheLocator

ROOT = Path(__file__).resolve().parent.parent
UNUSABLE = 2


@pytest.fixture
def kit(tmp_path, monkeypatch):
    """kit.py as a module that believes it stands in an empty folder, with its steps written down instead of run."""
    spec = importlib.util.spec_from_file_location("kit", ROOT / "kit.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    steps = []

    def pretend(command, problem, **options):
        steps.append(command[1:])
        if "venv" in command:
            (tmp_path / ".venv" / ("Scripts" if os.name == "nt" else "bin")).mkdir(parents=True, exist_ok=True)
            python = "Scripts/python.exe" if os.name == "nt" else "bin/python"
            (tmp_path / ".venv" / python).touch()

    monkeypatch.setattr(module, "ROOT", str(tmp_path))
    monkeypatch.setattr(module, "run", pretend)
    (tmp_path / "requirements.txt").write_text("numpy==2.4.6  # arrays\n", encoding="utf-8")
    module.steps = steps
    return module


@pytest.mark.parametrize(("version", "word"), [((3, 10, 13), "too old"), ((3, 14, 0), "too new")])
def test_a_python_that_does_not_fit_is_refused_in_one_line(kit, monkeypatch, capsys, version, word):
    monkeypatch.setattr(sys, "version_info", version)
    with pytest.raises(SystemExit) as end:
        kit.main(["doctor"])
    said = capsys.readouterr().err
    assert end.value.code == UNUSABLE
    assert word in said
    assert said.count("\n") == 1
    assert kit.steps == []


@pytest.mark.parametrize("version", [(3, 11, 0), (3, 12, 1), (3, 13, 9)])
def test_a_python_that_fits_is_accepted(kit, monkeypatch, version):
    monkeypatch.setattr(sys, "version_info", version)
    kit.check_python()


def test_an_old_python_can_read_kit_py_far_enough_to_be_told():
    modern = (ast.JoinedStr, ast.AnnAssign, ast.NamedExpr, ast.Match, ast.AsyncFunctionDef)
    tree = ast.parse((ROOT / "kit.py").read_text(encoding="ascii"))
    assert [node.lineno for node in ast.walk(tree) if isinstance(node, modern)] == []
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    assert [f.name for f in functions if f.returns or any(argument.annotation for argument in f.args.args)] == []


def test_kit_py_needs_only_the_standard_library():
    tree = ast.parse((ROOT / "kit.py").read_text(encoding="ascii"))
    imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    imported |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert imported <= set(sys.stdlib_module_names)


def test_the_second_run_installs_nothing(kit):
    kit.own_environment()
    assert [step[1] for step in kit.steps] == ["venv", "pip"]
    kit.own_environment()
    assert len(kit.steps) == 2


def test_changed_requirements_are_installed_and_a_moved_folder_is_made_anew(kit, tmp_path):
    kit.own_environment()
    (tmp_path / "requirements.txt").write_text("numpy==2.4.7\n", encoding="utf-8")
    kit.steps.clear()
    kit.own_environment()
    assert ["-m", "pip", "install", "-r", "requirements.txt"] in kit.steps
    assert not any("--clear" in step for step in kit.steps)
    stamp = tmp_path / ".venv" / "kit.stamp"
    stamp.write_text(stamp.read_text(encoding="utf-8").replace(str(tmp_path), "/elsewhere"), encoding="utf-8")
    kit.steps.clear()
    kit.own_environment()
    assert any("--clear" in step for step in kit.steps)


def test_a_package_in_another_version_is_noticed(kit, tmp_path):
    from importlib import metadata

    right = f"numpy=={metadata.version('numpy')}  # arrays\n"
    (tmp_path / "requirements.txt").write_text(right + "-e .\n", encoding="utf-8")
    assert kit.unmet() == []
    (tmp_path / "requirements.txt").write_text("numpy==0.1\nno-such-package==1.0\n", encoding="utf-8")
    assert kit.unmet() == ["numpy", "no-such-package"]


def test_kernels_are_compiled_again_only_after_one_changed(kit, tmp_path, monkeypatch):
    kernels = tmp_path / "kernels"
    kernels.mkdir()
    (kernels / "a.py").write_text("x = 1\n", encoding="utf-8")
    monkeypatch.setattr(kit, "KERNELS", str(kernels))
    python = kit.own_environment()
    kit.steps.clear()
    kit.warm(python, {})
    kit.warm(python, {})
    assert kit.steps == [["-m", "dualnav_lite", "warm"]]
    (kernels / "a.py").write_text("x = 2\n", encoding="utf-8")
    kit.warm(python, {})
    assert len(kit.steps) == 2


def test_checkouts_that_share_an_environment_keep_each_other_s_kernels(kit, tmp_path, monkeypatch):
    python = kit.own_environment()
    kit.steps.clear()
    for checkout in ("one", "two", "one", "two"):
        kernels = tmp_path / checkout / "kernels"
        (kernels / "__pycache__").mkdir(parents=True, exist_ok=True)
        (kernels / "a.py").write_text(f"x = '{checkout}'\n", encoding="utf-8")
        (kernels / "__pycache__" / "a.nbi").touch()
        monkeypatch.setattr(kit, "KERNELS", str(kernels))
        kit.warm(python, {})
    assert kit.steps == [["-m", "dualnav_lite", "warm"]] * 2
    assert (tmp_path / "one" / "kernels" / "__pycache__" / "a.nbi").exists()


@pytest.mark.parametrize("is_shared", [False, True])
def test_warm_removes_the_kernels_of_this_checkout_alone(kit, tmp_path, monkeypatch, is_shared):
    kernels, cache = tmp_path / "课程 one" / "kernels", tmp_path / "cache"
    kernels.mkdir(parents=True)
    (kernels / "a.py").touch()
    monkeypatch.setattr(kit, "KERNELS", str(kernels))
    shared = cache / _CacheLocator.get_suitable_cache_subpath(str(kernels / "a.py"))
    own = shared if is_shared else kernels / "__pycache__"
    others = [cache / "kernels_0123", cache / "physics_4567", cache, tmp_path / "else" / "kernels" / "__pycache__"]
    for folder in [own, *others]:
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("a.f-1.py311.nbi", "a.f-1.py311.1.nbc", "notes.txt"):
            (folder / name).touch()
    kit.warm(kit.own_environment(), {"NUMBA_CACHE_DIR": str(cache)} if is_shared else {})
    assert [path.name for path in own.iterdir()] == ["notes.txt"]
    assert all(len([path for path in folder.iterdir() if path.is_file()]) == 3 for folder in others)


def test_a_kernel_that_cannot_be_removed_is_said_and_tried_again_the_next_time(kit, tmp_path, monkeypatch, capsys):
    kernels = tmp_path / "kernels"
    locked = kernels / "__pycache__" / "locked.nbi"  # a folder, which is not removed as a file is
    locked.mkdir(parents=True)
    (kernels / "a.py").touch()
    (kernels / "__pycache__" / "a.nbi").touch()
    monkeypatch.setattr(kit, "KERNELS", str(kernels))
    python = kit.own_environment()
    kit.steps.clear()
    kit.warm(python, {})
    assert "1 old kernels cannot be removed" in capsys.readouterr().err
    assert not (kernels / "__pycache__" / "a.nbi").exists()
    locked.rmdir()
    kit.warm(python, {})
    kit.warm(python, {})
    assert kit.steps == [["-m", "dualnav_lite", "warm"]] * 2


def test_kernels_go_elsewhere_when_the_checkout_cannot_be_written(kit, tmp_path, monkeypatch):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("USERPROFILE", str(tmp_path / "home"))
    file = tmp_path / "file"
    file.touch()
    monkeypatch.setattr(kit, "KERNELS", str(file / "kernels"))  # a folder in a file: cannot be made by anybody
    assert kit.settings()["NUMBA_CACHE_DIR"].startswith(str(tmp_path / "home"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(file / "cache"))
    with pytest.raises(SystemExit) as end:
        kit.settings()
    assert end.value.code == UNUSABLE


def test_an_environment_that_lacks_something_is_left_alone(kit, monkeypatch):
    used = []
    monkeypatch.setattr(kit, "hand_over", lambda line, folder, variables: used.append(line[0]))
    monkeypatch.setattr(sys, "prefix", "/somebody/else")
    monkeypatch.setattr(kit, "unmet", lambda: ["numpy"])
    kit.main(["doctor"])
    monkeypatch.setattr(kit, "unmet", list)
    kit.main(["doctor"])
    assert used == [kit.own_environment(), sys.executable]


def test_lab_explains_its_own_option_before_jupyter_s(kit, tmp_path, monkeypatch, capsys):
    (tmp_path / "notebooks" / "src").mkdir(parents=True)
    monkeypatch.setattr(kit, "own_environment", lambda: "python")
    monkeypatch.setattr(kit, "unmet", list)
    monkeypatch.setattr(kit, "hand_over", lambda line, folder, variables: line)
    assert kit.main(["lab", "--student", "--help"])[-1] == "--help"
    assert "--student opens the lessons with stubs" in capsys.readouterr().err


def test_slow_tests_run_only_when_asked_for(kit):
    assert kit.command_line("python", "test", [])[0] == ["python", "-m", "pytest"]
    assert kit.command_line("python", "test", ["--slow", "-x"])[0] == ["python", "-m", "pytest", "-m", "", "-x"]


def test_a_student_s_version_says_where_tests_and_grading_are(tmp_path):
    shutil.copy2(ROOT / "kit.py", tmp_path)
    for command in ("test", "grade"):
        done = run_kit(tmp_path, command)
        assert done.returncode == UNUSABLE
        assert "the teacher" in done.stderr
        assert done.stderr.count("\n") == 1


def run_kit(folder, *arguments):
    """kit.py of a folder, run by this environment's Python from another folder."""
    command = [sys.executable, str(folder / "kit.py"), *arguments]
    return subprocess.run(command, cwd=folder.parent, capture_output=True, encoding="utf-8", check=False, timeout=120)


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """The kit in a folder whose name holds Chinese characters and a space."""
    folder = tmp_path_factory.mktemp("路径 规划") / "我的 机器人"
    skipped = shutil.ignore_patterns(".git", ".venv", "__pycache__", ".*_cache", "results", "course", "*.egg-info")
    shutil.copytree(ROOT, folder, ignore=skipped)
    return folder


@pytest.mark.parametrize(("arguments", "code"), [(["--help"], 0), ([], 2), (["fly"], 2), (["--version"], 2)])
def test_it_works_in_a_folder_with_chinese_characters_and_a_space(copy, arguments, code):
    done = run_kit(copy, *arguments)
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    if code and arguments:
        assert done.stderr.count("\n") == 1


def test_the_copy_uses_its_own_code_not_the_installed_one(copy):
    source = copy / "notebooks" / "src" / "99_extra.py"
    source.write_text("# %%\n1 + 1\n", encoding="utf-8")
    try:
        done = run_kit(copy, "notebooks", "--check")
        assert done.returncode == 1
        assert "99_extra.ipynb" in done.stdout
    finally:
        source.unlink()


@pytest.mark.parametrize(
    "arguments",
    [
        ["fly"],
        ["notebooks", "--wrong"],
        ["notebooks", "--take-back", "77"],
        ["evaluate"],
        ["evaluate", "no_such_arm", "--episodes", "1"],
        ["evaluate", "straight", "--scenarios", "no_such_scenario", "--episodes", "1"],
        ["evaluate", "straight", "--shard", "3"],
        ["evaluate", "straight", "--shard", "3/2"],
        ["evaluate", "straight", "--config", "no_such_file.yaml"],
        ["evaluate", ","],
        ["stress", "--arms", "no_such_arm"],
        ["stress", "--episodes", "0"],
        ["stress", "--episodes", "many"],
    ],
)
def test_unusable_input_is_one_line_and_exit_code_two(arguments, capsys, tmp_path, monkeypatch):
    from dualnav_lite.__main__ import main

    monkeypatch.chdir(tmp_path)
    assert main(arguments) == UNUSABLE
    said = capsys.readouterr()
    assert said.err.startswith("error: ")
    assert said.err.count("\n") == 1
    assert said.out == ""


def test_an_output_folder_that_refuses_is_one_line(capsys, tmp_path):
    from dualnav_lite.__main__ import main

    file = tmp_path / "file"
    file.touch()
    assert main(["evaluate", "stand_still", "--episodes", "1", "--out", str(file / "results")]) == UNUSABLE
    assert "cannot be written" in capsys.readouterr().err
    assert main(["stress", "--quick", "--arms", "stand_still", "--out", str(file / "results")]) == UNUSABLE
    assert "cannot be written" in capsys.readouterr().err


def test_evaluate_says_which_episodes_raised_and_ends_with_1(tmp_path, capsys, monkeypatch):
    from dualnav_lite.__main__ import main
    from dualnav_lite.planners.scripted import StandStill

    monkeypatch.setattr(StandStill, "command", lambda self, i, info: info["no such key"])
    command = ["evaluate", "stand_still", "--episodes", "1", "--jobs", "1"]
    assert main([*command, "--out", str(tmp_path / "results")]) == 1
    assert "FAILED navigation, stand_still: 1 episodes raised; the first: KeyError: 'no such key'" in (
        capsys.readouterr().err
    )
    assert len(pd.read_csv(tmp_path / "results" / "survival.csv").config_sha256[0]) == 64


def test_evaluate_and_record_take_the_config_s_scenario_unless_others_are_named(tmp_path):
    from dualnav_lite.__main__ import main

    config, out = tmp_path / "config.yaml", tmp_path / "results"
    config.write_text("scenario: pop_up\n", encoding="utf-8")
    command = ["evaluate", "straight", "--episodes", "1", "--jobs", "1", "--config", str(config), "--out", str(out)]
    assert main(command) == 0
    assert set(pd.read_csv(out / "episodes.csv").scenario) == {"pop_up"}
    assert main([*command, "--scenarios", "crowd_crossing"]) == 0
    assert set(pd.read_csv(out / "episodes.csv").scenario) == {"crowd_crossing"}
    assert (
        main(["record", "straight", "--episodes", "1", "--config", str(config), "--out", str(tmp_path / "data")]) == 0
    )
    assert set(pd.read_csv(tmp_path / "data" / "logs" / "episodes.csv").scenario) == {"pop_up"}


def test_a_shard_without_episodes_says_so_and_the_others_fill_the_table(tmp_path, capsys):
    from dualnav_lite.__main__ import main

    command = ["evaluate", "straight", "--episodes", "1", "--jobs", "1", "--out", str(tmp_path)]
    assert main([*command, "--shard", "2/2"]) == 0
    assert capsys.readouterr().out == "shard 2/2 holds no episodes: there are fewer chunks than shards\n"
    assert pd.read_csv(tmp_path / "survival.csv").empty
    assert main([*command, "--shard", "1/2"]) == 0
    assert len(pd.read_csv(tmp_path / "episodes.csv")) == 1


def test_every_command_explains_itself(capsys):
    from dualnav_lite.__main__ import app, main

    for command in app.registered_commands:
        assert main([command.callback.__name__, "--help"]) == 0
        assert "Usage" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="Ctrl-C is sent to a process group another way there")
def test_ctrl_c_ends_in_one_line_and_the_same_command_goes_on(tmp_path):
    command = [sys.executable, "-m", "dualnav_lite", "evaluate", "stand_still", "--jobs", "1"]
    command += ["--episodes", "555", "--out", str(tmp_path)]
    # A shell starts its background jobs deaf to Ctrl-C, and they hand that on to theirs.
    running = subprocess.Popen(
        command,
        cwd=ROOT,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    deadline = time.monotonic() + 120
    while not list(tmp_path.glob("chunks/*.csv")) and time.monotonic() < deadline:
        time.sleep(0.05)
    os.killpg(running.pid, signal.SIGINT)
    said = running.communicate(timeout=60)[1]
    assert running.returncode == 130
    assert said.rstrip().endswith("interrupted; the same command goes on from here")
    assert "Traceback" not in said
    assert not (tmp_path / "episodes.csv").exists()
    done = subprocess.run(command, cwd=ROOT, capture_output=True, encoding="utf-8", check=True, timeout=300)
    first = int(re.search(r" (\d+)/555 ", done.stderr)[1])  # where it starts: no finished chunk was run again
    assert first >= 50
    assert first % 50 == 0
    assert len((tmp_path / "episodes.csv").read_text(encoding="utf-8").splitlines()) == 556
