"""Two mistakes that PyYAML and pydantic let pass: a key that stands twice, true where a number is wanted."""

from collections.abc import Iterator
from typing import Any

import yaml


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
