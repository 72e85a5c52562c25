"""A class of submissions to tables: sandboxed, resumable, one result file a submission.

Killed at any moment and started again, nothing is lost and nothing is graded twice.
"""

import sys
from dataclasses import asdict
from pathlib import Path

from dualnav_lite.config import UnusableInput
from grading import __version__
from grading.cluster import run_on_cluster
from grading.crew import run_workers
from grading.feedback import page, zipped
from grading.folders import sweep
from grading.intake import Submission, take_in
from grading.lesson import Outcome
from grading.room import Room
from grading.rubric import Rubric
from grading.self_check import self_check
from grading.store import locked, read_result, result_path, to_json, write_whole
from grading.tables import COLUMNS, policy_tables, rows_of, to_csv


def grade_class(
    folder: Path,
    out: Path,
    room: Room,
    *,
    jobs: int = 1,
    cluster: str = "",
    shard: tuple[int, int] = (1, 1),
    only: str = "",
    overrides: dict | None = None,
    late: dict[str, float] | None = None,
    say=lambda text: print(text, file=sys.stderr),
) -> tuple[list[dict], int]:
    """Rows of the table, which is written too, and how many submissions stayed ungraded.

    Args:
        folder: submissions.
        out: folder of results and tables.
        room: what to grade with, from `prepared`.
        jobs: worker processes; cluster: address of a Dask scheduler, whose workers grade in their place.
        shard: (k, n) takes every n-th submission from the k-th.
        only: grade this student anew, whatever is there; the others as they are.

    Raises:
        UnusableInput: nothing can be graded.
    """
    sweep()
    submissions = take_in(folder, room.wanted())[shard[0] - 1 :: shard[1]]
    if only and only not in {one.student_id for one in submissions}:
        raise UnusableInput("--only names a student who is not in the folder")
    fingerprint = room.fingerprint()
    paths = {one.student_id: result_path(out, fingerprint, one) for one in submissions}
    with locked(out):
        if only:
            paths[only].unlink(missing_ok=True)
        missing = []
        for one in submissions:
            if read_result(paths[one.student_id]) is None:
                missing.append(one)
            else:  # we may have been killed between the result and its mark
                paths[one.student_id].with_suffix(".attempt").unlink(missing_ok=True)
        todo = [(one, paths[one.student_id]) for one in missing if not only or one.student_id == only]
        todo.sort(key=lambda task: task[1].with_suffix(".attempt").exists())  # in flight when we were killed: last
        lost = 0
        if todo and cluster:
            lost = run_on_cluster(room, todo, cluster, say)
        elif todo:
            self_check(room)
            lost = run_workers(room, todo, jobs, say)
        results = [_result_or_ungraded(room, one, paths[one.student_id]) for one in submissions]
        rows = write_tables(out, results, room.rubric, overrides or {}, late or {}, room.tier)
        write_times(out, list(paths.values()))
        made_of = {
            "fingerprint": fingerprint,
            "rubric": room.rubric.sha256(),
            "tier": room.tier,
            "results": sorted(path.name for path in paths.values()),
        }
        write_whole(out / "run.json", to_json(made_of))
    return rows, lost


def _result_or_ungraded(room: Room, submission: Submission, path: Path) -> dict:
    """A submission's result, with its folder as it is called now; where there is none, one that says so, no points."""
    found = read_result(path)
    if found is not None:
        return found | {"folder": submission.folder}
    nothing = asdict(Outcome(0.0, "ungraded", "sandbox_failed"))
    return {
        "assignment": room.rubric.assignment,
        "student_id": submission.student_id,
        "folder": submission.folder,
        "submission_sha256": submission.sha256,
        "outcomes": dict.fromkeys(room.rubric.points(), nothing),
        "prints": {},
        "library_prints": {},
        "tier": room.tier,
        "grader_version": __version__,
    }


def write_tables(out: Path, results: list[dict], rubric: Rubric, overrides, late, tier: str) -> list[dict]:
    """`grades.csv` (with UNSANDBOXED in its name where nothing protected us), what stands beside it, and feedback."""
    rows = rows_of(results, rubric, overrides, late)
    mark = ".UNSANDBOXED" if tier == "UNSANDBOXED" else ""
    write_whole(out / f"grades{mark}.csv", to_csv(COLUMNS, rows))
    if rubric.policy:
        for name, (columns, lines) in policy_tables(results).items():
            write_whole(out / f"{name}{mark}.csv", to_csv(columns, lines))
    write_feedback(out, results, rows, rubric, late)
    return rows


def write_times(out: Path, paths: list[Path]) -> None:
    """`grade_times.csv`: how long each submission took, from what stands beside the result files."""
    times = [found for path in paths if (found := read_result(path.with_suffix(".times")))]
    times.sort(key=lambda one: (one["student_id"], one["started"]))
    write_whole(out / "grade_times.csv", to_csv(("student_id", "started", "seconds"), times))


def write_feedback(out: Path, results: list[dict], rows: list[dict], rubric: Rubric, late: dict[str, float]) -> None:
    """`feedback/<folder>/feedback.html` of each student, and all of them as the zip that Moodle takes back."""
    margin, pages = rubric.policy.survival.margin if rubric.policy else 0.0, {}
    lessons = {exercise: name for name, lesson in rubric.lessons.items() for exercise in lesson.exercises}
    for one in results:
        student = one["student_id"]
        own = [row for row in rows if row["student_id"] == student]
        content = page(one, own, rubric.language, margin, late.get(student, 0.0), lessons)
        pages[one["folder"] or student] = content
        write_whole(out / "feedback" / (one["folder"] or student) / "feedback.html", content)
    write_whole(out / "feedback.zip", zipped(pages))


def merge(folders: list[Path], out: Path, rubric: Rubric, overrides, late) -> list[dict]:
    """Tables of shards that were graded apart, as if they had been graded together.

    Raises:
        UnusableInput: a folder holds no finished run, the runs were not made with the same grader, key and tier, or
            with another rubric, or a student stands in two of them.
    """
    runs = [read_result(folder / "run.json") for folder in folders]
    if not runs or None in runs:
        raise UnusableInput("merge: a folder holds no finished run (run.json)")
    if len({run["fingerprint"] for run in runs}) > 1:
        raise UnusableInput("merge: the shards were graded with different graders, rubrics, keys or tiers")
    if runs[0].get("rubric") != rubric.sha256():
        raise UnusableInput("merge: the shards were graded with another rubric; name it by --rubric")
    paths = [folder / "results" / name for folder, run in zip(folders, runs, strict=True) for name in run["results"]]
    with locked(out):
        results = [read_result(path) for path in paths]
        if None in results:
            raise UnusableInput("merge: a shard has a submission that stayed ungraded; run it again")
        if len({one["student_id"] for one in results}) < len(results):
            raise UnusableInput("merge: a student stands in two shards; name each shard once")
        write_times(out, paths)
        return write_tables(out, results, rubric, overrides, late, runs[0]["tier"])
