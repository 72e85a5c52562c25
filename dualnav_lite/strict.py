"""What PyYAML and pydantic let pass or leave unsaid: a key that stands twice, true for a number, the known keys."""

from collections.abc import Iterator
from typing import Any

import yaml
from pydantic import AfterValidator, BaseModel


def fixed(only: float, why: str) -> AfterValidator:
    """Refuses every number but one, for a key that is told but cannot be chosen; `why` says what rests on it."""

    def checked(value: float) -> float:
        if value != only:
            raise ValueError(f"only {only:g} is possible: {why}")
        return value

    return AfterValidator(checked)


def keys_beside(model: type[BaseModel], location: tuple) -> list[str]:
    """Known keys of the block that holds the last part of an error's location."""
    for part in location[:-1]:
        field = model.model_fields.get(part)
        annotation = field.annotation if field else None
        nested = [t for t in (annotation, *getattr(annotation, "__args__", ())) if isinstance(t, type)]
        models = [t for t in nested if issubclass(t, BaseModel)]
        if not models:
            return []
        model = models[0]
    return sorted(model.model_fields)


class UniqueKeys(yaml.SafeLoader):
    """PyYAML's safe loader, but a key that stands twice in a block is an error, as YAML itself has it."""

    def compose_mapping_node(self, anchor):
        """A block's node; `yaml.MarkedYAMLError` at the second of two equal keys."""
        node, first = super().compose_mapping_node(anchor), {}
        for key, _ in node.value:
            earlier = first.setdefault((key.tag, str(key.value)), key)
            if earlier is not key:
                problem = f"key '{key.value}' stands there twice, first in line {earlier.start_mark.line + 1}"
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
        return node


def taken_for_numbers(given: Any, kept: Any, place: str = "") -> Iterator[str]:
    """Dotted keys of every true or false that a model made into something else, which it does for numbers alone.

    Args:
        given: what the file holds.
        kept: the same place in what the model dumps.
        place: dotted key of this place.

    >>> list(taken_for_numbers({"speed": True, "is_fast": True}, {"speed": 1.0, "is_fast": True}))
    ['speed']
    """
    if isinstance(given, bool) and not isinstance(kept, bool):
        yield place
    elif isinstance(given, dict):
        for key, value in given.items():
            yield from taken_for_numbers(value, kept.get(key), f"{place}.{key}" if place else str(key))
    elif isinstance(given, list):
        for i, value in enumerate(given):
            yield from taken_for_numbers(value, kept[i], f"{place}.{i}")
