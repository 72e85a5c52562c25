"""Rows of real worlds are the same bytes from one process, two, three shards, a Dask cluster, and after kills."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from dualnav_lite.config import UnusableInput
from dualnav_lite.episodes import SEEDS
from dualnav_lite.evaluate import evaluate
from dualnav_lite.workers import checked_address, pool

SEEDS_HERE = SEEDS["tuning"][:5]
ARMS, SCENARIOS = ["ppo", "straight"], ["pop_up", "comms_dropout"]


def run(out, **settings):
    evaluate(ARMS, SCENARIOS, SEEDS_HERE, out, progress=False, **settings)
    return Path(out) / "episodes.csv"


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Bytes of the rows, from one process without interruption."""
    return run(tmp_path_factory.mktemp("whole")).read_bytes()


def test_two_processes_and_three_shards_give_the_same_bytes(whole, tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules["dualnav_lite.evaluate"], "LITTLE", 0)  # else so few are run without processes
    assert run(tmp_path / "two", jobs=2).read_bytes() == whole
    for k in (3, 1, 2):
        path = run(tmp_path / "shards", shard=(k, 3))
    assert path.read_bytes() == whole


def test_a_dask_cluster_of_two_workers_gives_the_same_bytes(whole, tmp_path):
    distributed = pytest.importorskip("distributed")
    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1", local_directory=str(tmp_path / "d")
    )
    with cluster:
        assert run(tmp_path / "dask", cluster=cluster.scheduler_address).read_bytes() == whole


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
@pytest.mark.parametrize("chunks_before", [0, 1, 3])
def test_killed_at_any_moment_and_run_again_nothing_is_lost_and_nothing_twice(whole, tmp_path, chunks_before):
    killed_at(tmp_path, chunks_before, delay_s=0.0)
    assert run(tmp_path).read_bytes() == whole


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_killed_twenty_times_nothing_is_lost_and_nothing_twice(whole, tmp_path):
    for k in range(20):
        folder = tmp_path / str(k)
        killed_at(folder, k % 4, delay_s=0.03 * k)
        assert run(folder).read_bytes() == whole
        shutil.rmtree(folder)


def killed_at(out, chunks_before, delay_s):
    """Run in a process of its own and kill that some time after a number of chunks was written."""
    code = f"import test_workers as t; t.run(r'{out}')"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])}
    process = subprocess.Popen([sys.executable, "-c", code], env=environment)
    give_up = time.monotonic() + 120
    while process.poll() is None and time.monotonic() < give_up:
        if (out / "run.json").exists() and len(list((out / "chunks").glob("[!.]*.csv"))) >= chunks_before:
            time.sleep(delay_s)
            process.send_signal(signal.SIGKILL)
            break
        time.sleep(0.005)
    process.wait(timeout=120)
    assert (out / "run.json").exists()


@pytest.mark.parametrize(
    ("address", "word"),
    [("localhost:8786", "tcp://host:port"), ("tcp://nowhere", "tcp://host:port"), ("tcp://192.0.2.7:8786", "tls://")],
)
def test_an_address_that_will_not_do_is_refused_before_anything_runs(address, word):
    with pytest.raises(UnusableInput, match=word):
        checked_address(address)


def test_a_cluster_that_is_not_there_is_one_clear_line():
    pytest.importorskip("distributed")
    with pytest.raises(UnusableInput, match="nobody answers"), pool(cluster="tcp://127.0.0.1:9"):
        pass


def test_few_episodes_are_run_where_they_are_and_one_long_run_by_one_process():
    from dualnav_lite.chunks import Chunk
    from dualnav_lite.evaluate import LITTLE, _workers_worth
    from dualnav_lite.scenario import load_scenario

    def chunks(count, seeds, scenario="pop_up"):
        return [Chunk(load_scenario(scenario), "ppo", tuple(range(seeds)), None)] * count

    assert _workers_worth(chunks(4, 5), 2) == 1
    assert _workers_worth(chunks(4, LITTLE), 2) == 2
    assert _workers_worth(chunks(1, 5, "battery"), 2) == 1
    assert _workers_worth(chunks(2, 5, "battery"), 8) == 2
    assert _workers_worth([], 2) == 1


def test_driving_an_evaluation_imports_nothing_that_its_chunks_do_not_know_nor_torch():
    code = (
        "import sys, dualnav_lite.evaluate as e; from dualnav_lite.config import Config; from pathlib import Path\n"
        "from dualnav_lite import chunks\n"
        "for arm in ('ppo_filter', 'cv_sampling', 'ceiling'): e.library_arm(arm, Config())\n"
        "names = {name.split('.')[1] for name in sys.modules if name.startswith('dualnav_lite.')}\n"
        "above = {Path(name).stem for name in chunks.ABOVE_ROWS}\n"
        "root = Path(chunks.__file__).parent\n"
        "missing = [name for name in chunks.ABOVE_ROWS if not (root / name).exists()]\n"
        "print(sorted(names & above), missing, 'torch' in sys.modules, 'jupytext' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[] [] False False"


@pytest.mark.skipif(os.name != "posix", reason="on Windows workers finish their chunk")
def test_workers_end_soon_after_a_killed_parent(tmp_path):
    code = (
        "import os, pathlib, sys, time, joblib\n"
        "from dualnav_lite.workers import pool\n"
        "def work(k):\n"
        f"    pathlib.Path(r'{tmp_path}', f'{{os.getpid()}}.pid').touch()\n"
        "    time.sleep(120)\n"
        "with pool(2) as parallel:\n"
        "    list(parallel(joblib.delayed(work)(k) for k in range(2)))\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code])
    give_up = time.monotonic() + 60
    while len(workers := [int(path.stem) for path in tmp_path.glob("*.pid")]) < 2:
        assert time.monotonic() < give_up
        time.sleep(0.1)
    parent.kill()
    parent.wait()
    give_up = time.monotonic() + 20
    while any(is_running(pid) for pid in workers):
        assert time.monotonic() < give_up, "a worker outlives its parent"
        time.sleep(0.1)


def is_running(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False
