"""`python -m grading.attacks [NAME ...]`: all attacks, or some, and how each ended. 0: as they should; 1: not."""

import json
import sys
from typing import Annotated

import typer

from dualnav_lite.config import UnusableInput
from grading.attacks.graded import run_all
from grading.attacks.table import read_table
from grading.tiers import choose_tier

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)


@app.command()
def attack(
    names: Annotated[list[str] | None, typer.Argument(help="Attacks by name; all if none is named.")] = None,
    tier: Annotated[str, typer.Option(help="A or B; the best that works if empty.")] = "",
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object in place of a table.")] = False,
) -> int:
    """Hand in hostile submissions, grade them, and compare each ending with the one that it must have."""
    table = read_table()
    unknown = sorted(set(names or []) - set(table))
    if unknown:
        raise UnusableInput(f"no attack '{unknown[0]}'; known: {', '.join(table)}")
    chosen = choose_tier(wanted=tier)
    attacks = [table[name] for name in names] if names else list(table.values())
    endings, wrong = run_all(attacks, chosen, lambda text: print(text, file=sys.stderr))
    if as_json:
        told = {one.attack.name: [one.right, one.found] for one in endings}
        print(json.dumps({"tier": chosen, "endings": told, "wrong": wrong}))
    else:
        for one in endings:
            print(f"{'as it should' if one.right else 'WRONG':<13}{one.attack.name:<28}{', '.join(one.found.values())}")
        for line in wrong:
            print(f"WRONG        {line}")
        print(f"tier {chosen}: {sum(one.right for one in endings)} of {len(endings)} ended as they should")
    return 0 if not wrong and all(one.right for one in endings) else 1


if __name__ == "__main__":
    try:
        sys.exit(app(standalone_mode=False) or 0)
    except (UnusableInput, typer.TyperException) as error:
        print(f"error: {' '.join(getattr(error, 'format_message', error.__str__)().split())}", file=sys.stderr)
        sys.exit(2)
