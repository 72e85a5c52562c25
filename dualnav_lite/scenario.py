"""Scenarios are data: `stress_tests/scenarios/<id>.yaml`, read here into frozen, checked settings."""

import math
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, NonNegativeInt, model_validator

from dualnav_lite.config import (
    CONTROL_DT_S,
    ROOT,
    Config,
    Frozen,
    NonNegative,
    Positive,
    Share,
    UnusableInput,
    read_yaml,
    validated,
)
from dualnav_lite.intervals import MAX_MOVERS, Boxes, Few, Lengths, Pieces, Radii, Range, Shares, Sides, Speeds, Times

SCENARIO_FOLDER = ROOT / "stress_tests" / "scenarios"
# Worlds with scenarios of their own: the robot's, the second one with cars, several robots in one room.
WORLDS = {"pymunk": SCENARIO_FOLDER, "highway": SCENARIO_FOLDER / "highway", "fleet": SCENARIO_FOLDER / "fleet"}
HALL_END_M, HALL_SIDE_M = 0.7, 2.0  # a hall's journey keeps this from the walls at its ends and beside it
DOOR_END_M = 0.8  # a door keeps this from both ends of its wall
STRESS_SCENARIOS = ("pop_up", "crowd_crossing", "low_light", "battery", "comms_dropout")  # of test mode


class Room(Frozen):
    """Walls, furniture and the journey through them."""

    size_m: Sides = Range(low=8, high=12)
    walled_share: Share = 0.08  # share of rooms cut in two by a wall with one door; SPEC 8: at most 10 %
    door_width_m: Lengths = Range(low=0.95, high=1.15)
    furniture: Pieces = Range(low=5, high=11)
    pushable_boxes: Few = Range(low=0, high=2)
    goal_distance_m: Lengths = Range(low=4, high=8)  # as the crow flies
    heading_error_rad: NonNegative = 3.1416  # starting heading, off the goal's direction by at most this
    hall: bool = False  # furniture stays clear of the journey


class People(Frozen):
    """Pedestrians between waypoints; they avoid the robot by social force."""

    count: Few = Range(low=0, high=3)
    speed_m_s: Speeds = Range(low=0.4, high=1.0)
    radius_m: Radii = Range(low=0.25, high=0.30)
    unaware_share: Share = 0.0  # share of them who walk on whatever is in their way; only to train the predictor
    forklift_share: Share = 0.10  # share of rooms with a forklift-sized mover on a fixed lane


class PopUp(Frozen):
    """Boxes that slide into the robot's way when its odometer passes a drawn value, at any speed."""

    count: Boxes = Range(low=1, high=3)
    placement: Literal["beside", "cover", "head_on"] = "beside"
    ahead_m: Positive = 2.0
    side_m: Lengths = Range(low=0.7, high=1.0)
    speed_m_s: Positive = 1.5
    stop_within_m: NonNegative = 0.15  # of the robot's line
    half_size_m: Radii = Range(low=0.15, high=0.25)
    first_trigger_m: Lengths = Range(low=0.4, high=1.6)
    next_trigger_m: Lengths = Range(low=1.4, high=2.2)
    passage_m: Positive = 0.85
    goal_gap_m: NonNegative = 0.9
    box_gap_m: NonNegative = 1.3


class Crowd(Frozen):
    """A group that waits at its entrance and crosses the robot's journey to meet it."""

    count: Annotated[int, Field(ge=1, le=MAX_MOVERS)] = 5
    reactive: bool = False
    speed_m_s: Positive = 0.8
    radius_m: Radii = Range(low=0.25, high=0.30)
    gap_m: Lengths = Range(low=0.2, high=0.5)  # between surfaces
    line_share: Shares = Range(low=0.3, high=0.7)  # where on the journey the crossing line lies
    lead_s: Times = Range(low=1.5, high=5.5)  # the group starts when the robot is this short of the line
    aim_error_s: NonNegative = 0.6
    wall_gap_m: Positive = 1.4
    clear_line_m: NonNegative = 0.8  # the last of the group has crossed the line by this much before it stops
    pause_s: Times = Range(low=0, high=4)


class Sensing(Frozen):
    """Light and what it does to the lidar."""

    ambient_lux: Positive = 300.0
    phantoms: Annotated[int, Field(ge=0, le=8)] = 0
    phantom_life_s: Times = Range(low=0.5, high=2.5)
    phantom_ahead_m: Lengths = Range(low=0.7, high=2.5)
    phantom_radius_m: Radii = Range(low=0.10, high=0.25)


class Link(Frozen):
    """Radio between the robot and the off-board mapper."""

    delay_s: Annotated[float, Field(ge=0, le=60)] = 0.0
    loss: Annotated[float, Field(ge=0, lt=1)] = 0.0
    burst_mean_s: NonNegative = 0.0  # 0: every message is lost or not by itself

    @model_validator(mode="after")
    def _bursts_can_be(self):
        packets = max(1.0, self.loss / (1.0 - self.loss))
        if 0.0 < self.burst_mean_s / CONTROL_DT_S < packets:
            least = math.ceil(1000.0 * packets * CONTROL_DT_S) / 1000.0
            raise ValueError(
                f"burst_mean_s must be 0 or at least {least:g} s to lose {self.loss:g} of all maps in bursts"
            )
        return self


class Dispatcher(Frozen):
    """Goals in a row for a long run."""

    duration_s: Positive = 10800.0
    period_s: Positive = 20.0
    contact_penalty_s: NonNegative = 30.0
    min_goals: NonNegativeInt = 520
    min_charge: Share = 0.15
    max_contacts: NonNegativeInt = 12
    goal_clearance_m: Positive = 0.6


class Cars(Frozen):
    """A task of highway-env (`simulator: highway`); of the other blocks only the titles count then."""

    task: Literal["parking", "traffic"]
    others: NonNegativeInt = 0  # cars besides the driven one
    limit_s: Positive = 30.0


class Fleet(Frozen):
    """Several robots of one kind in one room (`fleet.FleetWorlds`)."""

    robots: Annotated[int, Field(ge=2, le=4)] = 3
    radio_m: Positive = 5.0  # within it robots know of each other
    cross_weight: NonNegative = 0.3  # of the cross-agent term in r_dynamic (article 4.5)


class Scenario(Frozen):
    """One row of the survival table: what the world holds and when a run counts as survived."""

    id: str
    title: str
    title_zh: str
    article_claim: Share | None = None  # survival rate the article reports
    room: Room = Room()
    people: People = People()
    pop_up: PopUp | None = None
    crowd: Crowd | None = None
    sensing: Sensing = Sensing()
    link: Link = Link()
    dispatcher: Dispatcher | None = None
    cars: Cars | None = None
    fleet: Fleet | None = None
    start_charge: Shares = Range(low=0.15, high=1.0)
    goal_radius_m: Positive = 0.4
    time_limit_paths: Positive = 2.0  # time limit = this x shortest path / hardware.max_lin_vel + time_limit_extra_s
    time_limit_extra_s: NonNegative = 15.0

    @model_validator(mode="after")
    def _movers_fit(self):
        counts = {
            "people.count": int(self.people.count.high),
            "people.forklift_share": int(self.people.forklift_share > 0),
            "room.pushable_boxes": int(self.room.pushable_boxes.high),
            "pop_up.count": int(self.pop_up.count.high) if self.pop_up else 0,
            "crowd.count": self.crowd.count if self.crowd else 0,
        }
        if sum(counts.values()) > MAX_MOVERS:
            parts = ", ".join(f"{name} {count}" for name, count in counts.items() if count)
            raise ValueError(f"a world holds {MAX_MOVERS} movers, here are up to {sum(counts.values())}: {parts}")
        return self

    @model_validator(mode="after")
    def _room_holds_its_parts(self):
        if self.cars or self.fleet:
            return self  # their rooms have neither a hall's journey nor a door
        room, side = self.room, self.room.size_m.low
        if room.hall and side < max(2 * HALL_SIDE_M, room.goal_distance_m.low + 2 * HALL_END_M):
            raise ValueError(
                f"room.size_m.low must be at least {2 * HALL_SIDE_M:g} m in a hall, and {2 * HALL_END_M:g} m more than "
                f"room.goal_distance_m.low ({room.goal_distance_m.low:g}), got {side:g}"
            )
        if room.walled_share > 0 and side < room.door_width_m.high + 2 * DOOR_END_M:
            raise ValueError(
                f"room.door_width_m.high must be at most {side - 2 * DOOR_END_M:g} m: the wall is room.size_m.low "
                f"({side:g}) long and goes on for {DOOR_END_M:g} m on either side, got {room.door_width_m.high:g}"
            )
        return self


def _merged(base: dict, changes: dict) -> dict:
    """The base with nested changes laid over it."""
    merged = dict(base)
    for key, value in changes.items():
        nested = isinstance(value, dict) and isinstance(merged.get(key), dict)
        merged[key] = _merged(merged[key], value) if nested else value
    return merged


def read_scenarios(path: str | Path) -> dict[str, Scenario]:
    """The scenario of a file and its variants, by id; a variant `x` of the file `a` has the id `a_x`."""
    values: Any = read_yaml(path)
    if not isinstance(values, dict):
        raise UnusableInput(f"{path}: a scenario file holds keys and values, got {type(values).__name__}")
    variants = values.pop("variants", {}) or {}
    if not isinstance(variants, dict) or not all(isinstance(one, dict) for one in variants.values()):
        raise UnusableInput(f"{path}: variants holds a name and the changed keys of each")
    found = {}
    for name, changes in {"": {}, **variants}.items():
        merged = _merged(values, changes)
        if name:
            merged["id"] = f"{values.get('id')}_{name}"
        scenario = validated(Scenario, merged, f"{path}{f' (variant {name})' if name else ''}")
        found[scenario.id] = scenario
    if Path(path).stem not in found:
        raise UnusableInput(f"{path}: id must be the file's name '{Path(path).stem}', got '{values.get('id')}'")
    return found


@cache
def all_scenarios(folder: Path = SCENARIO_FOLDER) -> dict[str, Scenario]:
    """Every scenario and variant in a folder, by id, files in alphabetical order."""
    found: dict[str, Scenario] = {}
    for path in sorted(Path(folder).glob("*.yaml")):
        found.update(read_scenarios(path))
    if not found:
        raise UnusableInput(f"{folder}: no scenario files (*.yaml) here")
    return found


def load_scenario(asked: str | Scenario, world: str | None = None) -> Scenario:
    """The scenario with this id, or in the YAML file with this path; a `Scenario` comes back as it is.

    Args:
        asked: id, path or `Scenario`.
        world: one of `WORLDS` that it must belong to; None for any of them.

    Raises:
        UnusableInput: no such scenario, or it belongs to another world.
    """
    known = {name: one for folder in WORLDS.values() for name, one in all_scenarios(folder).items()}
    here = all_scenarios(WORLDS[world]) if world else known
    if isinstance(asked, Scenario):
        found = asked
    elif asked.endswith((".yaml", ".yml")):
        found = next(iter(read_scenarios(asked).values()))
    elif asked in known:
        found = known[asked]
    else:
        raise UnusableInput(f"unknown scenario '{asked}'; known: {', '.join(here)}")
    if world and world != _world_of(found):
        raise UnusableInput(f"scenario '{found.id}' {_way_into(found)}; known here: {', '.join(here)}")
    return found


def _world_of(scenario: Scenario) -> str:
    return "highway" if scenario.cars else "fleet" if scenario.fleet else "pymunk"


def _way_into(scenario: Scenario) -> str:
    """What drives a scenario, as the end of a sentence."""
    if scenario.cars:
        command, env = f"beyond {scenario.cars.task}", "dualnav_lite.highway.HighwayEnv (simulator: highway)"
        return f"is of cars: run `python kit.py {command}`, or make a {env}"
    if scenario.fleet:
        return "is of several robots: run `python kit.py beyond fleet`, or make a dualnav_lite.fleet.env.FleetEnv"
    return "is of one robot: make a DynamicNavEnv (simulator: pymunk)"


def configured_scenarios(config: Config) -> list[str]:
    """Names of the scenarios that a config asks for: the five stress scenarios in test mode, else its own."""
    return list(STRESS_SCENARIOS) if config.test_mode else [config.scenario]


def resolve_scenarios(config: Config, scenario) -> list[Scenario]:
    """The robot's scenarios to draw from: those asked for, else the configured ones.

    Raises:
        UnusableInput: one that does not exist or is of another world, or none at all.
    """
    if scenario is None:
        scenario = configured_scenarios(config)
    asked = [scenario] if isinstance(scenario, str | Scenario) else list(scenario)
    if not asked:
        raise UnusableInput(f"scenario: at least one is wanted, got none; known: {', '.join(all_scenarios())}")
    return [load_scenario(one, "pymunk") for one in asked]
