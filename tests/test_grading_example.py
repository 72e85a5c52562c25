"""The example class comes out as its table says: alone, in two processes, in shards and on a cluster."""

import shutil

import pytest

from grading.example.graded import DUE, HERE, compared, differences, example_rubric, grade_example
from grading.grade import merge
from grading.late import late_shares
from tests.test_attacks import works


def silent(text):
    pass


def files_of(out):
    """Bytes by name of all that depends on the submissions alone."""
    names = ("grades.csv", "survival.csv", "pareto.csv", "feedback.zip")
    return {name: (out / name).read_bytes() for name in names}


def test_a_broken_notebook_and_a_part_that_stands_on_a_wrong_one_come_out_as_expected(tmp_path):
    works("A")
    for name in ("carla", "frank"):
        shutil.copytree(HERE / "class" / name, tmp_path / "class" / name)
    table = grade_example(tmp_path / "out", folder=tmp_path / "class", rubric=example_rubric("07_rewards"), say=silent)
    right = {(row["student_id"], row["exercise"]): row for row in compared((HERE / "grades.csv").read_bytes())}
    alone = ("submission_sha256",)  # of all that is handed in, of which only a lesson is taken here
    found = [{name: row[name] for name in row if name not in alone} for row in compared(table)]
    wanted = [right[row["student_id"], row["exercise"]] for row in found]
    assert found == [{name: row[name] for name in row if name not in alone} for row in wanted]
    assert {row["status"] for row in found} == {"not_run", "partial", "passed", "failed"}
    told = (tmp_path / "out" / "feedback" / "frank" / "feedback.html").read_text(encoding="utf-8")
    assert "NameError: name &#x27;SAFE_DISTNACE&#x27; is not defined" in told


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The example class graded in two processes; its folder."""
    works("A")
    out = tmp_path_factory.mktemp("example") / "whole"
    grade_example(out, jobs=2, say=silent)
    return out


@pytest.mark.slow
def test_two_processes_grade_the_example_class_as_expected_and_nobody_is_graded_again(whole):
    assert differences((whole / "grades.csv").read_bytes()) == []
    before, kept = files_of(whole), {path: path.stat().st_mtime_ns for path in (whole / "results").iterdir()}
    grade_example(whole, say=silent)
    assert files_of(whole) == before
    assert {path: path.stat().st_mtime_ns for path in kept} == kept


@pytest.mark.slow
def test_three_shards_give_the_same_bytes_when_they_are_merged(whole, tmp_path):
    for k in (3, 1, 2):
        grade_example(tmp_path / str(k), shard=(k, 3), say=silent)
    rubric = example_rubric()
    late = late_shares(HERE / "times.csv", DUE, rubric.late)
    merge([tmp_path / str(k) for k in (1, 2, 3)], tmp_path / "all", rubric, {}, late)
    assert files_of(tmp_path / "all") == files_of(whole)


@pytest.mark.slow
def test_a_dask_cluster_gives_the_same_bytes(whole, tmp_path):
    distributed = pytest.importorskip("distributed")
    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1", local_directory=str(tmp_path / "d")
    )
    with cluster:
        grade_example(tmp_path / "out", cluster=cluster.scheduler_address, say=silent)
    assert files_of(tmp_path / "out") == files_of(whole)
