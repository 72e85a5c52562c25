"""What a run of `stress_tests/case.ipynb` is about: scenarios that share a notebook, and what is said of them."""

from functools import cache
from typing import Annotated

from pydantic import Field

from dualnav_lite.config import Frozen, UnusableInput, read_yaml, validated
from dualnav_lite.scenario import SCENARIO_FOLDER, load_scenario

CASE_FILE = SCENARIO_FOLDER.parent / "cases.yaml"


class Case(Frozen):
    """One row group of the survival table.

    Attributes:
        scenarios: ids, the article's own first.
        is_long: runs last hours, so they have arms and a count of their own.
        about: what happens and what the article claims; change: what a reader could try next.
    """

    scenarios: Annotated[list[str], Field(min_length=1)]
    is_long: bool = False
    about: str
    change: str


@cache
def all_cases() -> dict[str, Case]:
    """Every case by name, in the article's order.

    Raises:
        UnusableInput: a file that cannot be used, or a scenario that does not exist.
    """
    values = read_yaml(CASE_FILE)
    if not isinstance(values, dict) or not values:
        raise UnusableInput(f"{CASE_FILE}: holds cases by name")
    cases = {name: validated(Case, value, f"{CASE_FILE}: {name}") for name, value in values.items()}
    for case in cases.values():
        for scenario in case.scenarios:
            load_scenario(scenario, "pymunk")
    return cases


def load_case(name: str) -> Case:
    """The case of this name; `UnusableInput` names the known ones."""
    cases = all_cases()
    if name not in cases:
        raise UnusableInput(f"unknown case '{name}'; known: {', '.join(cases)}")
    return cases[name]
