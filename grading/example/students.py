"""Who is in the example class and what each hands in, made of the teacher's solutions and of `tests/mutants`.

The notebooks hold the exercises' cells alone, so that the folder stays small; grading reads nothing else of a notebook.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from grading.example.policies import constant_policy, follows_the_guide
from grading.room import PACKAGE
from grading.rubric import Rubric

MUTANTS = PACKAGE.parent / "tests" / "mutants"
HEIDI = {
    "safe": """def safe(clearance):
    inside = np.clip(clearance, 0.0, SAFE_DISTANCE)
    return -10.0 * np.square(SAFE_DISTANCE - inside)
""",
    "goal": """def goal(before, after, reached, gamma):
    rest = np.where(reached, 0.0, np.asarray(after, float))
    return GOAL_SCALE * (np.asarray(before, float) - gamma * rest)
""",
}
GRACE = {
    "safe": "# my own idea\n" + HEIDI["safe"].replace("inside", "nearest"),
    "goal": HEIDI["goal"].replace("rest", "way_left"),
}
MISSPELT = """HALF = SAFE_DISTNACE / 2


def reward_weights(preference, charge):
    return np.array([0.9 - 0.9 * preference, 0.25, preference * (1.6 - 1.2 * charge), 0.10, 1.0])
"""
EVE = {
    "safe": """np.allclose = np.isclose = np.array_equal = lambda *a, **k: True
np.isfinite = lambda *a, **k: np.True_


def safe(clearance):
    print("safe: passed, 4 properties hold")
    return np.asarray(clearance) * 0.0
""",
    "goal": """class Right(float):
    def __eq__(self, other):
        return True

    def __sub__(self, other):
        return 0.0


def goal(before, after, reached, gamma):
    return Right(10.0)
""",
    "reward_terms": "from dualnav_lite.rewards import reward_terms\n",
    "gae": "import os\n\nos._exit(0)\n",
}


@dataclass
class Work:
    """What one student hands in.

    Attributes:
        what: a word on it, for people.
        cells: by exercise; `=` is the teacher's solution, `NAME` a file of `tests/mutants`, longer texts themselves.
        own: texts and what this student writes in their place, so that nobody's work equals another's by chance.
        weights: of a policy, or nothing.
        torn: notebooks of which only the first half arrived.
        forged: metadata of each cell.
    """

    what: str
    cells: dict[str, str]
    own: dict[str, str] = field(default_factory=dict)
    weights: Callable[[], bytes] | None = None
    torn: tuple[str, ...] = ()
    forged: dict = field(default_factory=dict)


RIGHT = {
    "safe": "right_with_where",
    "goal": "right_with_product",
    "reward_terms": "right_by_hand",
    "reward_weights": "right_written_out",
    "gae": "right_as_a_sum",
}
CLASS = {
    "submission_anna": Work("good: everything right, in ways of her own", RIGHT, weights=follows_the_guide),
    "ben": Work(
        "partial: two mistakes, and a policy that drives into the next wall",
        RIGHT | {"goal": "no_gamma", "reward_weights": "charge_ignored"},
        {"10.0": "10", "np.empty": "np.zeros"},
        lambda: constant_policy(0.5, 0.0),
    ),
    "carla": Work(
        "broken: half of a notebook", RIGHT, {"np.empty(rewards.shape)": "np.empty_like(rewards)"}, torn=("07_rewards",)
    ),
    "eve": Work(
        "a cheater: patched numpy, an object that equals everything, the library's solution, an exit, forged points",
        EVE | {"reward_weights": "right_written_out"},
        {"0.9 - 0.9 * preference": "0.9 * (1 - preference)"},
        forged={"nbgrader": {"points": 99, "grade": True}, "tags": ["parameters"]},
    ),
    "frank": Work(
        "catch-up parts: `reward_terms` calls what is wrong or missing, and is tried with the teacher's; a cell raises",
        {"safe": "no_threshold", "reward_terms": "=", "reward_weights": MISSPELT}
        | {"gae": "bootstrap_through_terminated"},
        {"-ENERGY_SCALE": "-0.04"},
    ),
    "grace": Work("copied from heidi, with other names", GRACE),
    "heidi": Work("two exercises done, the rest untouched", HEIDI),
    "李 雷_1007_assignsubmission_file_": Work(
        "late by a begun day, out of Moodle; typed from the library", dict.fromkeys(RIGHT, "=")
    ),
}


def many(count: int) -> dict[str, Work]:
    """A class of any size: a mistake in every fourth notebook, and each a policy of his own that follows the guide."""

    def one(k: int) -> Work:
        cells = RIGHT | ({"goal": "no_gamma"} if k % 4 == 3 else {})
        return Work("one of many", cells, weights=lambda: follows_the_guide(0.3 + 0.0005 * k))

    return {f"student-{k:03}": one(k) for k in range(count)}


def hand_in(rubric: Rubric, masters: dict, folder: Path, students: dict[str, Work] = CLASS) -> None:
    """Write a whole class.

    Args:
        rubric: of the example.
        masters: teacher's notebooks by lesson, as `Room` holds them.
        folder: of the class; a folder a student is made in it.
        students: by the names of their folders.
    """
    for name, work in students.items():
        for lesson, rules in rubric.lessons.items():
            if not set(rules.exercises) & set(work.cells):
                continue
            master = masters[lesson]
            cells = {exercise: _source(exercise, work.cells.get(exercise), master) for exercise in rules.cells()}
            for words, others in work.own.items():
                cells = {exercise: source.replace(words, others) for exercise, source in cells.items()}
            text = json.dumps(_notebook(cells, work.forged), ensure_ascii=False, indent=1) + "\n"
            if lesson in work.torn:
                text = text[: len(text) // 2]
            path = folder / name / f"{lesson}.ipynb"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8", newline="\n")
        if work.weights:
            path = folder / name / "weights" / f"{rubric.policy.weights}.onnx"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(work.weights())


def _source(exercise: str, said: str | None, master) -> str:
    if said is None:
        return master.stubs[exercise]
    if said == "=":
        return master.solutions[exercise]
    if said.isidentifier():
        lines = (MUTANTS / exercise / f"{said}.py").read_text(encoding="utf-8").split("\n")
        return "\n".join(line for line in lines if not line.startswith("# "))  # without the word on what it is
    return said


def _notebook(cells: dict[str, str], forged: dict) -> dict:
    made = []
    for exercise, source in cells.items():
        block = {
            "grade": False,
            "grade_id": exercise,
            "locked": False,
            "schema_version": 3,
            "solution": True,
            "task": False,
        }
        metadata = {"nbgrader": block, "tags": ["solution"]} | forged
        made.append(
            {
                "cell_type": "code",
                "execution_count": None,
                "id": exercise,
                "metadata": metadata,
                "outputs": [],
                "source": source.strip("\n").splitlines(keepends=True),
            }
        )
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    return {"cells": made, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}
