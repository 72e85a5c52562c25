"""`rubric.yaml` read and checked: exercises, points, what is masked, what a trained policy must reach."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from dualnav_lite.chunks import sha256
from dualnav_lite.config import Frozen, Positive, Share, read_yaml, validated
from dualnav_lite.scenario import load_scenario
from grading.tasks import task_of

RUBRIC = Path(__file__).resolve().parent / "rubric.yaml"
Count = Annotated[int, Field(ge=1)]
Points = Annotated[float, Field(gt=0)]


class Exercise(Frozen):
    """One exercise: what it is worth, what it calls, how long its questions may take together.

    Attributes:
        of: exercise whose cell is asked, where this one has no cell of its own and is a further task on that one.
    """

    points: Points
    of: str = ""
    needs: tuple[str, ...] = ()
    seconds: Positive = 10.0


class Survival(Frozen):
    """When a trained policy passes; all of it is told to students.

    Attributes:
        thresholds: least rate by scenario; each scenario is worth the same.
        margin: what students are told to aim at lies so far above the threshold.
        confidence: of the exact interval, over all looks at it together.
        first, most: seeds of a scenario at the first look, and at the last.
        seeds: number of them by scenario, for scenarios that are looked at once, such as three-hour runs.
    """

    points: Points
    thresholds: Annotated[dict[str, Share], Field(min_length=1)]
    margin: Share = 0.1
    confidence: Annotated[float, Field(gt=0.5, lt=1)] = 0.95
    first: Count = 20
    most: Count = 80
    seeds: dict[str, Count] = Field(default={})

    @model_validator(mode="after")
    def _ordered(self):
        if self.most < self.first:
            raise ValueError("most is less than first")
        strangers = sorted(set(self.seeds) - set(self.thresholds))
        if strangers:
            raise ValueError(f"seeds names '{strangers[0]}', which has no threshold")
        return self

    def of(self, scenario: str) -> "Survival":
        """The rule of one scenario."""
        count = self.seeds.get(scenario)
        return self.model_copy(update={"first": count, "most": count}) if count else self


Objectives = dict[Literal["safe_dist_m", "energy_j_per_goal"], float]


class Hypervolume(Frozen):
    """Share of the box between two points that the policy's (safety, energy) points dominate, one a preference."""

    points: Points
    scenario: str
    preferences: Annotated[tuple[Share, ...], Field(min_length=1)]
    reference: Objectives
    ideal: Objectives
    threshold: Share
    seeds: Count

    @model_validator(mode="after")
    def _is_a_box(self):
        if len(self.reference) != 2 or len(self.ideal) != 2:
            raise ValueError("reference and ideal each hold safe_dist_m and energy_j_per_goal")
        if self.ideal["safe_dist_m"] <= self.reference["safe_dist_m"]:
            raise ValueError("the ideal is no safer than the reference")
        if self.ideal["energy_j_per_goal"] >= self.reference["energy_j_per_goal"]:
            raise ValueError("the ideal is no thriftier than the reference")
        return self


class Policy(Frozen):
    """A trained policy, handed in as `weights/<weights>.onnx` or `.pth`.

    Attributes:
        seconds: that it may think, over all episodes.
    """

    weights: Annotated[str, Field(pattern=r"^[A-Za-z0-9_]+$")] = "ppo_actor"
    seconds: Positive = 300.0
    survival: Survival
    hypervolume: Hypervolume | None = None

    def points(self) -> dict[str, float]:
        """Most points by exercise."""
        found = {"survival": self.survival.points}
        return found | ({"hypervolume": self.hypervolume.points} if self.hypervolume else {})


class Lesson(Frozen):
    """A notebook's exercises, and what of the library answers them."""

    exercises: Annotated[dict[str, Exercise], Field(min_length=1)]
    mask: dict[str, str] = Field(default={})

    @model_validator(mode="after")
    def _fits(self):
        known: list[str] = []
        for name, exercise in self.exercises.items():
            unknown = sorted({exercise.of, *exercise.needs} - {"", *known})
            if unknown:
                raise ValueError(f"'{name}' needs '{unknown[0]}', which does not stand before it")
            if not exercise.of:
                known.append(name)
        strangers = sorted(set(self.mask.values()) - set(known))
        if strangers:
            raise ValueError(f"mask names '{strangers[0]}', which is no exercise here")
        return self

    def cells(self) -> tuple[str, ...]:
        """Exercises with a cell of their own."""
        return tuple(name for name, exercise in self.exercises.items() if not exercise.of)


class Late(Frozen):
    """What delay costs, as a share of the points."""

    per_day: Share = 0.0
    most: Share = 1.0


class Rubric(Frozen):
    """All of it."""

    assignment: Annotated[str, Field(pattern=r"^[a-z0-9_-]+$")]
    total: Points
    language: Literal["en", "zh"] = "en"
    late: Late = Late()
    lessons: dict[Annotated[str, Field(pattern=r"^[a-z0-9_]+$")], Lesson] = Field(default={})
    policy: Policy | None = None

    @model_validator(mode="after")
    def _adds_up(self):
        names = [name for lesson in self.lessons.values() for name in lesson.exercises]
        if len(set(names)) != len(names) or (self.policy and set(names) & set(self.policy.points())):
            raise ValueError("an exercise stands in two places")
        found = sum(self.points().values())
        if abs(found - self.total) > 1e-9:
            raise ValueError(f"the points add up to {found:g}, total says {self.total:g}")
        return self

    def points(self) -> dict[str, float]:
        """Most points by exercise, in order."""
        parts = {name: one.points for lesson in self.lessons.values() for name, one in lesson.exercises.items()}
        return parts | (self.policy.points() if self.policy else {})

    def sha256(self) -> str:
        """Hash of all of it."""
        return sha256(self.model_dump_json())

    def mask(self) -> dict[str, str]:
        """Exercise by symbol of the library that answers it."""
        return {symbol: name for lesson in self.lessons.values() for symbol, name in lesson.mask.items()}


def load_rubric(path: Path = RUBRIC) -> Rubric:
    """The rubric in a file.

    Raises:
        UnusableInput: it cannot be read, something in it does not fit, an exercise has no scorer, a scenario is none.
    """
    rubric = validated(Rubric, read_yaml(path), path.name)
    for lesson in rubric.lessons.values():
        for name in lesson.exercises:
            task_of(name)
    if rubric.policy:
        further = [rubric.policy.hypervolume.scenario] if rubric.policy.hypervolume else []
        for name in [*rubric.policy.survival.thresholds, *further]:
            load_scenario(name, "pymunk")
    return rubric
