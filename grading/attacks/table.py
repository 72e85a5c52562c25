"""The table of attacks, read from the YAML files of this folder and checked."""

from dataclasses import dataclass, field
from pathlib import Path

import yaml

from dualnav_lite.config import UnusableInput

HERE = Path(__file__).resolve().parent
FILES = ("resources.yaml", "doors.yaml", "answers.yaml", "files.yaml")
EXERCISES = ("safe", "goal", "survival")  # a part beside the attacked one, that one, and the trained policy


@dataclass
class Attack:
    """One hostile submission.

    Attributes:
        group: file that it stands in, such as `doors`.
        name: a word; the folder it is handed in as, unless `folder` says otherwise.
        line: the line of the list of attacks that it stands for.
        cell: source of the cell `goal`; `@NAME@` becomes what `Canaries.places` holds.
        honest: whether the right solution follows, which is taken back where a `must_fail` did not fail.
        wire: statements run inside the called function, with the scorer's `connection` and the call's `number`.
        cell_of: source made by repeating a text.
        notebook: forged `metadata`, `cell` (metadata of the cell), `outputs`, `extra` cells, `half_character`.
        put: further files by path: a text, or one of `link`, `pipe`, `folders`, `sparse`, `repeat`, `pickle`,
            `torch_archive`, `network_that_says`, `zip_of_zeros`.
        folder: name on disk.
        goal: endings that are right, as "status reason".
        safe: of the part beside it; survival: of the policy.
        tier_b: endings of `goal` where tier B ends otherwise.
    """

    name: str
    line: str
    group: str = ""
    cell: str = ""
    honest: bool = False
    wire: str = ""
    cell_of: dict = field(default_factory=dict)
    notebook: dict = field(default_factory=dict)
    put: dict = field(default_factory=dict)
    folder: str = ""
    goal: tuple[str, ...] = ("passed",)
    safe: tuple[str, ...] = ("passed",)
    survival: tuple[str, ...] = ("not_run no_weights",)
    tier_b: tuple[str, ...] = ()

    def endings(self, tier: str) -> dict[str, tuple[str, ...]]:
        """Right endings by exercise."""
        goal = self.tier_b if self.tier_b and tier == "B" else self.goal
        return {"safe": self.safe, "goal": goal, "survival": self.survival}


def _endings(value) -> tuple[str, ...]:
    return (value,) if isinstance(value, str) else tuple(value)


def read_table() -> dict[str, Attack]:
    """All attacks by name, in the order of the files.

    Raises:
        UnusableInput: an entry has an unknown key, or a name stands twice.
    """
    found: dict[str, Attack] = {}
    for name in FILES:
        for entry in yaml.safe_load((HERE / name).read_text(encoding="utf-8")):
            entry = dict(entry)
            everything = entry.pop("all", None)
            if everything:
                entry |= dict.fromkeys(EXERCISES, everything)
            for key in (*EXERCISES, "tier_b"):
                if key in entry:
                    entry[key] = _endings(entry[key])
            try:
                attack = Attack(group=name.removesuffix(".yaml"), **entry)
            except TypeError as error:
                raise UnusableInput(f"{name}: {entry.get('name')}: {error}") from None
            if attack.name in found:
                raise UnusableInput(f"{name}: the attack '{attack.name}' stands twice")
            found[attack.name] = attack
    return found
