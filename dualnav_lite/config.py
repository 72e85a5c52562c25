"""Every number of the kit that is not a scenario: frozen, checked, written out in full on first use."""

import io
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import IO, Annotated, Any, Literal, TypeVar

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, NonNegativeInt, PositiveInt, ValidationError, model_validator

from dualnav_lite.strict import UniqueKeys, fixed, keys_beside, taken_for_numbers

ROOT = Path(__file__).resolve().parent.parent  # of the whole kit
CONTROL_DT_S = 0.1  # from one scan, decision and command to the next


class UnusableInput(ValueError):
    """A config, scenario, file or folder that cannot be used; its text is one line a person can act on."""


class UnknownName(UnusableInput):
    """A name that stands for nothing here: no such arm, no such model."""


class Frozen(BaseModel):
    """A block of settings that refuses unknown keys and cannot change after it was read."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]


class Hardware(Frozen):
    """Limits of the real motors (article 4.3); `action_space` is their box."""

    max_lin_vel: Positive = 0.8  # [m/s]
    max_ang_vel: Positive = 1.2  # [rad/s]

    @property
    def limits(self) -> np.ndarray:
        """(2,) largest v [m/s] and omega [rad/s]; the smallest are minus these."""
        return np.array([self.max_lin_vel, self.max_ang_vel])


class Robot(Frozen):
    """Differential drive, its wheel loop and its odometry."""

    hull_radius_m: Positive = 0.20
    track_width_m: Positive = 0.30
    mass_kg: Positive = 15.0
    max_lin_acc_m_s2: Positive = 1.0
    max_ang_acc_rad_s2: Positive = 2.5
    motor_lag_s: NonNegative = 0.05
    pid_kp: NonNegative = 1.2
    pid_ki: NonNegative = 4.0
    pid_kd: NonNegative = 0.01
    odometry_distance_drift: NonNegative = 0.01  # standard deviation of the scale error of an episode
    odometry_heading_drift: NonNegative = 0.01  # standard deviation of the turning scale error of an episode


class Power(Frozen):
    """Watts: idle + linear |v| + quadratic v^2 + turn |omega| + turn_quadratic omega^2 + mass max(0, v dv/dt)."""

    idle_w: NonNegative = 5.0
    linear_w_s_m: NonNegative = 8.0
    quadratic_w_s2_m2: NonNegative = 20.0
    turn_w_s: NonNegative = 6.0
    turn_quadratic_w_s2: NonNegative = 4.0
    capacity_wh: Positive = 46.5  # from stress_tests/reference/battery_calibration.csv

    @model_validator(mode="after")
    def _driving_costs(self):
        if not (self.idle_w or self.linear_w_s_m or self.quadratic_w_s2_m2):
            raise ValueError(
                "one of idle_w, linear_w_s_m and quadratic_w_s2_m2 must be above 0: r_energy is a share of what "
                "driving straight draws"
            )
        return self


class Lidar(Frozen):
    """A full turn of beams at every control step; beam k points at -pi + 2 pi k / beams in the robot's frame."""

    beams: Annotated[int, Field(ge=16, le=4096)] = 1080
    range_min_m: Positive = 0.05
    range_max_m: Positive = 10.0
    label_confusion: Share = 0.02  # share of hits whose surface the semantic front end gets wrong
    faintest: Share = 0.0  # weaker returns are dropped, ghosts first and dark walls with them: the rival of channel 3

    @model_validator(mode="after")
    def _ordered(self):
        if self.range_max_m <= self.range_min_m:
            raise ValueError(f"range_max_m ({self.range_max_m:g}) must lie above range_min_m ({self.range_min_m:g})")
        return self


class Map(Frozen):
    """Rolling semantic map, built online from scans."""

    resolution_m: Annotated[float, fixed(0.1, "observation, guide and planners count in cells of it")] = 0.1
    cells: Annotated[int, Field(ge=64, le=512, multiple_of=2)] = 160
    cache: bool = True  # re-project the last received map to the believed pose and lay the current scan over it
    match_steps: NonNegativeInt = 3  # between two fits of a scan to the received map; 0: odometry alone


class Guide(Frozen):
    """Where the policy is told to head next: a point along the planned path, or the goal itself."""

    method: Literal["astar", "goal"] = "astar"
    distance_m: Positive = 2.5
    replan_steps: PositiveInt = 3


class Motion(Frozen):
    """What channel 1 of the observation shows."""

    method: Literal["farneback", "forecast", "scan", "none", "truth"] = "forecast"
    component: Literal["x", "radial", "speed"] = "x"  # of the optical flow; only Farneback reads it


class Observation(Frozen):
    """Image the policy sees; `flat` puts the last three scans into channel 0 as one row of numbers, no space in it."""

    layout: Literal["image", "flat"] = "image"
    intensity: bool = True  # the fourth channel (article 4.4)
    motion: Motion = Motion()
    battery: Literal["measured", "full"] = "measured"  # what the charge's band shows


class Rewards(Frozen):
    """Reward terms and their weights; weights of the five terms in the order of `rewards.TERMS`."""

    form: Literal["repaired", "article", "article_fixed"] = "repaired"
    safe: NonNegative = 0.45
    dynamic: NonNegative = 0.25
    energy: NonNegative = 0.20
    goal: NonNegative = 0.10
    terminal: NonNegative = 1.0
    gamma: Annotated[float, Field(gt=0, le=1)] = 1.0  # of the goal's potential; below 1 standing still earns interest


class Config(Frozen):
    """The whole configuration; `config.yaml` holds exactly these keys."""

    simulator: Literal["pymunk", "highway"] = "pymunk"
    test_mode: bool = False  # the environment draws the stress scenarios itself (article 5.3)
    scenario: str = "navigation"
    preference: Share | Literal["drawn"] = 0.5  # 0 all safety, 1 all thrift
    control_dt_s: Annotated[
        float, fixed(CONTROL_DT_S, "flow, forecasts, predictor and trained policies count in steps of it")
    ] = CONTROL_DT_S
    physics_dt_s: Positive = 0.02
    hardware: Hardware = Hardware()
    robot: Robot = Robot()
    power: Power = Power()
    lidar: Lidar = Lidar()
    map: Map = Map()
    guide: Guide = Guide()
    predictor: Literal["constant_velocity", "lstm"] = "constant_velocity"  # of the forecast channel and of r_dynamic
    observation: Observation = Observation()
    rewards: Rewards = Rewards()

    @model_validator(mode="after")
    def _steps_fit(self):
        substeps = self.control_dt_s / self.physics_dt_s
        if abs(substeps - round(substeps)) > 1e-9 or substeps < 1:
            raise ValueError("control_dt_s must be a whole multiple of physics_dt_s")
        if self.observation.layout == "flat" and 3 * self.lidar.beams > 64 * 64:
            raise ValueError(f"a flat observation holds 4096 readings, three scans of {self.lidar.beams} do not fit")
        return self

    @property
    def substeps(self) -> int:
        """Physics steps in a control step."""
        return round(self.control_dt_s / self.physics_dt_s)


AnyModel = TypeVar("AnyModel", bound=BaseModel)


def validated(model: type[AnyModel], values: Any, source: str) -> AnyModel:
    """An instance of the model, or `UnusableInput` naming the first wrong key and, if unknown, the known ones."""
    try:
        made = model.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "(top level)"
        if first["type"] == "extra_forbidden":
            known = ", ".join(keys_beside(model, first["loc"]))
            raise UnusableInput(f"{source}: unknown key '{key}'; known keys here: {known}") from None
        got = "" if isinstance(first["input"], dict) else f", got {first['input']!r}"
        raise UnusableInput(f"{source}: {key}: {first['msg']}{got}") from None
    wrong = next(taken_for_numbers(values, made.model_dump()), None)
    if wrong is not None:
        raise UnusableInput(f"{source}: {wrong}: a number is wanted, got true or false")
    return made


def read_yaml(path: str | Path) -> Any:
    """Content of a YAML file; `UnusableInput` with file and line where it cannot be read."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise UnusableInput(f"{path}: cannot be read: {reason}") from None
    try:
        return yaml.load(text, UniqueKeys)
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # a 13th month, nests too deep: not PyYAML's own
        mark = getattr(error, "problem_mark", None)
        where = f" in line {mark.line + 1}" if mark else ""
        problem = " ".join(str(getattr(error, "problem", None) or error).split())
        raise UnusableInput(f"{path}: not valid YAML{where}: {problem}") from None


def _umask() -> int:
    """The process's mask for new files; it can only be read by setting it."""
    mask = os.umask(0)
    os.umask(mask)
    return mask


_UMASK = _umask()


def write_atomic(path: str | Path, content: str | bytes | Callable[[IO[bytes]], object]) -> None:
    """Write a file whole or not at all: beside it, fsync, rename. `UnusableInput` where the folder refuses.

    Args:
        path: of the file; its folder is made.
        content: text (UTF-8), bytes, or what writes them into a file that it is given.
    """
    path = Path(path)
    if callable(content):
        buffer = io.BytesIO()
        content(buffer)
        content = buffer.getvalue()
    data = content.encode("utf-8") if isinstance(content, str) else content
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o666 & ~_UMASK)  # mkstemp's files are for nobody else
        os.replace(temporary, path)
    except OSError as error:
        if temporary:
            Path(temporary).unlink(missing_ok=True)
        raise UnusableInput(f"{path}: cannot be written: {error.strerror}") from None


def load_config(path: str | Path | None = None) -> Config:
    """The configuration in a YAML file; without a path the defaults.

    A missing file is written with every default first (the article does so), so that a reader sees all keys.
    """
    if path is None:
        return Config()
    if not Path(path).exists():
        write_atomic(path, dump_config(Config()))
    values = read_yaml(path)
    return validated(Config, {} if values is None else values, str(path))


def dump_config(config: BaseModel) -> str:
    """YAML text of a resolved configuration, keys in their declared order."""
    return yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False, allow_unicode=True)


def with_overrides(config: AnyModel, overrides: dict[str, Any]) -> AnyModel:
    """The same settings with some keys changed, named by dotted paths.

    >>> with_overrides(Config(), {"hardware.max_lin_vel": 0.5}).hardware.max_lin_vel
    0.5
    """
    values = config.model_dump()
    for path, value in overrides.items():
        *blocks, key = path.split(".")
        target = values
        for block in blocks:
            target = target.get(block) if isinstance(target, dict) else None
        if not isinstance(target, dict) or key not in target:
            known = ", ".join(sorted(target)) if isinstance(target, dict) else ", ".join(sorted(values))
            raise UnusableInput(f"override: unknown key '{path}'; known keys here: {known}")
        target[key] = value
    return validated(type(config), values, "override")
