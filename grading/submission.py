"""One submission to the content of its result file."""

import hashlib
import time
from dataclasses import asdict

from grading import __version__
from grading.intake import Changed, Submission
from grading.lesson import Outcome, grade_lesson
from grading.policy import grade_policy
from grading.rebuild import Unreadable, normalised, solution_cells
from grading.room import ENDINGS, Room


def grade_one(room: Room, submission: Submission) -> dict:
    """The content of a submission's result file, but for times.

    Raises:
        Changed: what was handed in is no longer what it was.
    """
    files = submission.read()
    outcomes: dict[str, Outcome] = {}
    prints: dict[str, str] = {}
    library: dict[str, str] = {}
    said: dict[str, str] = {}
    for name, lesson in room.rubric.lessons.items():
        sources: dict[str, str] = {}
        problem = submission.rejected
        content = files.get(f"{name}.ipynb")
        if not problem:
            try:
                sources = solution_cells(content, lesson.cells()) if content is not None else {}
                problem = "" if content is not None else "no_notebook"
            except Unreadable as error:
                problem = str(error)
        if problem:
            outcomes |= {exercise: Outcome(0.0, "not_run", problem) for exercise in lesson.exercises}
            continue
        found, words = grade_lesson(room.setting(name), sources)
        outcomes |= found
        said |= {exercise: text for exercise, text in words.items() if found[exercise].status != "passed"}
        for exercise, source in sources.items():
            if found[exercise].reason not in ("not_done", "cell_missing") and not source.startswith("\0"):
                prints[exercise] = _print(source)
                library[exercise] = _print(room.masters[name].solutions[exercise])
    if room.rubric.policy:
        outcomes |= _policy(room, submission, files, prints, library)
    return {
        "assignment": room.rubric.assignment,
        "student_id": submission.student_id,
        "folder": submission.folder,
        "submission_sha256": submission.sha256,
        "outcomes": {exercise: asdict(outcome) for exercise, outcome in outcomes.items()},
        "prints": prints,
        "library_prints": library,
        "said": said,
        "tier": room.tier,
        "grader_version": __version__,
    }


def grade_timed(room: Room, submission: Submission) -> tuple[dict | None, dict]:
    """The same, None where something stayed ungraded so that the next run tries again; and how long it took."""
    start = time.time()
    try:
        result = grade_one(room, submission)
    except Changed:
        return None, {}
    times = {"student_id": submission.student_id, "started": round(start), "seconds": round(time.time() - start, 1)}
    ungraded = any(outcome["status"] == "ungraded" for outcome in result["outcomes"].values())
    return None if ungraded else result, times


def _policy(
    room: Room,
    submission: Submission,
    files: dict[str, bytes],
    prints: dict[str, str],
    library: dict[str, str],
) -> dict[str, Outcome]:
    """Outcomes of the policy task; a hash of the weights goes into `prints`, since copies are reported."""
    policy = room.rubric.policy
    names = [f"{policy.weights}{ending}" for ending in ENDINGS]
    found = next((files[name] for name in names if name in files), None)
    if submission.rejected or not found:
        return dict.fromkeys(policy.points(), Outcome(0.0, "not_run", submission.rejected or "no_weights"))
    own = hashlib.sha256(found).hexdigest()
    for exercise in policy.points():
        prints[exercise] = own
        library[exercise] = own if own in room.shipped_weights() else ""
    return grade_policy(room.setting(), policy, found)


def _print(source: str) -> str:
    return hashlib.sha256(normalised(source).encode("utf-8", "replace")).hexdigest()[:16]
