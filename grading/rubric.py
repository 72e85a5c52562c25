"""`rubric.yaml` read and checked: exercises, points, what is masked, what a trained policy must reach."""

from pathlib import Path
from typing import Annotated, Literal

import yaml
from pydantic import Field, ValidationError, model_validator

from dualnav_lite.config import Frozen, Positive, Share, UnusableInput
from grading.tasks import questions_of

RUBRIC = Path(__file__).resolve().parent / "rubric.yaml"
Count = Annotated[int, Field(ge=1)]
Points = Annotated[float, Field(gt=0)]


class Exercise(Frozen):
    """One exercise: what it is worth, what it calls, how long a call of it may take."""

    points: Points
    needs: tuple[str, ...] = ()
    seconds: Positive = 10.0


class Survival(Frozen):
    """When a trained policy passes; all of it is told to students."""

    points: Points
    threshold: Share
    margin: Share
    confidence: Annotated[float, Field(gt=0.5, lt=1)]
    first: Count
    most: Count


class Hypervolume(Frozen):
    """Share of the box between two points that the policy's (safety, energy) points dominate."""

    points: Points
    preferences: tuple[Share, ...]
    reference: dict[Literal["safe_dist_m", "energy_j"], float]
    ideal: dict[Literal["safe_dist_m", "energy_j"], float]
    threshold: Share
    seeds: Count


class Lesson(Frozen):
    """A notebook's exercises, or a policy."""

    exercises: dict[str, Exercise]
    mask: dict[str, str] = Field(default={})
    weights: str = ""
    scenarios: tuple[str, ...] = ()
    survival: Survival | None = None
    hypervolume: Hypervolume | None = None
    start_s: Positive = 60.0  # until the student's own cells have run

    @model_validator(mode="after")
    def _fits(self):
        known: list[str] = []
        for name, exercise in self.exercises.items():
            unknown = sorted(set(exercise.needs) - set(known))
            if unknown:
                raise ValueError(f"'{name}' needs '{unknown[0]}', which does not stand before it")
            known.append(name)
        strangers = sorted(set(self.mask.values()) - set(known))
        if strangers:
            raise ValueError(f"mask names '{strangers[0]}', which is no exercise here")
        if bool(self.weights) != bool(self.survival):
            raise ValueError("weights and survival go together")
        if self.weights:
            parts = [part.points for part in (self.survival, self.hypervolume) if part]
            total = sum(exercise.points for exercise in self.exercises.values())
            if len(self.exercises) != 1 or abs(sum(parts) - total) > 1e-9:
                raise ValueError(f"survival and hypervolume are worth {sum(parts)}, the exercise {total}")
            if self.survival.most < self.survival.first:
                raise ValueError("survival: most is less than first")
        return self


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
    lessons: dict[Annotated[str, Field(pattern=r"^[a-z0-9_]+$")], Lesson]

    @model_validator(mode="after")
    def _adds_up(self):
        found = sum(one.points for lesson in self.lessons.values() for one in lesson.exercises.values())
        if abs(found - self.total) > 1e-9:
            raise ValueError(f"the points add up to {found:g}, total says {self.total:g}")
        names = [name for lesson in self.lessons.values() for name in lesson.exercises]
        if len(set(names)) != len(names):
            raise ValueError("an exercise stands in two lessons")
        return self

    def points(self) -> dict[str, float]:
        """Most points by exercise, in order."""
        return {name: one.points for lesson in self.lessons.values() for name, one in lesson.exercises.items()}


def load_rubric(path: Path = RUBRIC) -> Rubric:
    """The rubric in a file.

    Raises:
        UnusableInput: it cannot be read, something in it does not fit, or an exercise has no scorer.
    """
    try:
        rubric = Rubric.model_validate(yaml.safe_load(path.read_text(encoding="utf-8")))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise UnusableInput(f"{path.name}: cannot be read: {' '.join(str(error).split())[:200]}") from None
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise UnusableInput(f"{path.name}: {place}{': ' if place else ''}{first['msg']}") from None
    for lesson in rubric.lessons.values():
        for name in () if lesson.weights else lesson.exercises:
            questions_of(name)
    return rubric
