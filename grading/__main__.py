"""The commands: `python -m grading --help`. Exit codes: 0 done, 1 something stayed ungraded, 2 unusable input."""

import sys
from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from dualnav_lite.config import UnusableInput

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None, no_args_is_help=True)
Key = Annotated[Path | None, typer.Option(help="Key file of the hidden seeds; `python -m grading key` makes one.")]
Out = Annotated[Path, typer.Option(help="Folder of results and tables.")]
RubricFile = Annotated[Path | None, typer.Option(help="In place of grading/rubric.yaml.")]
Overrides = Annotated[Path | None, typer.Option(help="CSV: student_id,exercise,points,reason.")]
Times = Annotated[Path | None, typer.Option(help="CSV: student_id,submitted (ISO time); with --due.")]
Due = Annotated[str, typer.Option(help="When the work was due, ISO time; later costs what the rubric says.")]


def _late(times: Path | None, due: str, rubric) -> dict[str, float]:
    """Share of the points that delay costs, by student."""
    from grading.tables import read_csv

    if bool(times) != bool(due):
        raise UnusableInput("--times and --due go together")
    found = {}
    for k, row in enumerate(read_csv(times, ("student_id", "submitted")) if times else [], 2):
        try:
            seconds = (datetime.fromisoformat(row["submitted"]) - datetime.fromisoformat(due)).total_seconds()
        except (ValueError, TypeError):
            raise UnusableInput(f"line {k} of the times, or --due: no ISO time, or a zone in one alone") from None
        days = max(0, -int(-seconds // 86400))
        found[row["student_id"]] = min(rubric.late.most, days * rubric.late.per_day)
    return found


@app.command()
def key(file: Annotated[Path, typer.Argument(help="A new file, outside the course's repository.")]) -> int:
    """Make a key file for the hidden seeds."""
    from grading.secret import make_key

    make_key(file)
    print(f"{file}: keep it secret and keep a copy: without it no grade can be computed again")
    return 0


@app.command()
def probe(tier: Annotated[str, typer.Option(help="A or B; the best that works if empty.")] = "") -> int:
    """Try what a sandbox must deny here, and say what holds."""
    from grading.job import SandboxError
    from grading.probe import leaks
    from grading.probe import probe as try_all
    from grading.tiers import TIERS, choose_tier

    chosen = choose_tier(wanted=tier)
    try:
        found = try_all(chosen)
    except SandboxError as error:
        raise UnusableInput(str(error)) from None
    for name, denied in sorted(found.items()):
        print(f"{'denied' if denied else 'OPEN':<8}{name}")
    print(f"tier {chosen}: {TIERS[chosen]}")
    return 1 if leaks(found) else 0


@app.command()
def grade(
    folder: Annotated[Path, typer.Argument(help="Submissions, a folder a student, or Moodle's bulk download.")],
    key: Key = None,
    out: Out = Path("grades"),
    jobs: Annotated[int, typer.Option(min=1, help="Sandboxes side by side.")] = 1,
    shard: Annotated[str, typer.Option(help="k/n: every n-th submission from the k-th; `merge` joins them.")] = "1/1",
    only: Annotated[str, typer.Option(help="Grade this student again, and nobody else.")] = "",
    tier: Annotated[str, typer.Option(help="A or B; the best that works if empty.")] = "",
    rubric: RubricFile = None,
    overrides: Overrides = None,
    times: Times = None,
    due: Due = "",
    unsafe_no_sandbox: Annotated[bool, typer.Option("--unsafe-no-sandbox", help="Run code of others as you.")] = False,
) -> int:
    """Grade submissions in sandboxes; the same command goes on where it was stopped."""
    from grading.grade import grade_class
    from grading.job import Limits
    from grading.room import PACKAGE, prepared
    from grading.rubric import RUBRIC, load_rubric
    from grading.secret import load_secret
    from grading.shown import refuse_shown
    from grading.tables import read_overrides
    from grading.tiers import choose_tier

    rules = load_rubric(rubric or RUBRIC)
    secret = load_secret(key, rules.assignment)
    if out.resolve().is_relative_to(folder.resolve()) or folder.resolve().is_relative_to(out.resolve()):
        raise UnusableInput(f"--out {out} and {folder} lie in one another; results stand apart from what is handed in")
    refuse_shown(folder, out, PACKAGE.parent, *([key] if key else []))
    chosen = choose_tier(unsafe_no_sandbox, tier)
    if chosen == "UNSANDBOXED":
        print("WARNING: no sandbox. Code of others runs with your rights; every row says UNSANDBOXED.", file=sys.stderr)
    try:
        index, count = (int(part) for part in shard.split("/"))
    except ValueError:
        index = count = 0
    if not 1 <= index <= count:
        raise UnusableInput(f"a shard reads k/n, such as 2/8; got '{shard}'")
    changed = read_overrides(overrides, rules)
    late = _late(times, due, rules)
    with prepared(rules, secret, chosen, Limits()) as room:
        rows, lost = grade_class(
            folder, out, room, jobs=jobs, shard=(index, count), only=only, overrides=changed, late=late
        )
    students = len({row["student_id"] for row in rows})
    print(f"{students} submissions graded in tier {chosen}: {out}")
    if lost:
        print(f"{lost} stayed ungraded; the same command tries them again", file=sys.stderr)
    return 1 if lost else 0


@app.command()
def merge(
    folders: Annotated[list[Path], typer.Argument(help="Folders of the shards.")],
    out: Out = Path("grades"),
    rubric: RubricFile = None,
    overrides: Overrides = None,
    times: Times = None,
    due: Due = "",
) -> int:
    """Join the tables of shards."""
    from grading.grade import merge as join
    from grading.rubric import RUBRIC, load_rubric
    from grading.tables import read_overrides

    rules = load_rubric(rubric or RUBRIC)
    rows = join(folders, out, rules, read_overrides(overrides, rules), _late(times, due, rules))
    print(f"{len({row['student_id'] for row in rows})} submissions: {out}")
    return 0


def main(arguments: list[str] | None = None) -> int:
    """Run a command and give its exit code; what cannot be used ends in one line on stderr and code 2."""
    try:
        return app(arguments, standalone_mode=False) or 0
    except (UnusableInput, typer.TyperException) as error:
        message = getattr(error, "format_message", error.__str__)()
        print(f"error: {' '.join(message.split())}", file=sys.stderr)
        return 2
    except (KeyboardInterrupt, typer.Abort):
        print("\ninterrupted; the same command goes on from here", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
