"""The commands: `python -m grading --help`. Exit codes: 0 done, 1 something stayed ungraded, 2 unusable input."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from dualnav_lite.config import UnusableInput

INTERRUPTED = 130
app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None, no_args_is_help=True)
Key = Annotated[Path | None, typer.Option(help="Key file of the hidden seeds; `python -m grading key` makes one.")]
Out = Annotated[Path, typer.Option(help="Folder of results and tables.")]
RubricFile = Annotated[Path | None, typer.Option(help="In place of grading/rubric.yaml.")]
Tier = Annotated[str, typer.Option(help="A or B; the best that works if empty.")]
Overrides = Annotated[Path | None, typer.Option(help="CSV: student_id,exercise,points,reason.")]
Times = Annotated[Path | None, typer.Option(help="CSV: student_id,submitted (ISO time); with --due.")]
Jobs = Annotated[int, typer.Option(min=1, help="Sandboxes side by side.")]
Cluster = Annotated[str, typer.Option(help="tcp://host:port of a Dask scheduler in place of --jobs.")]
Due = Annotated[str, typer.Option(help="When the work was due, ISO time; later costs what the rubric says.")]


@app.command()
def key(file: Annotated[Path, typer.Argument(help="A new file, outside the course's repository.")]) -> int:
    """Make a key file for the hidden seeds."""
    from grading.secret import make_key

    make_key(file)
    print(f"{file}: keep it secret and keep a copy: without it no grade can be computed again")
    return 0


@app.command()
def probe(tier: Tier = "") -> int:
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
    jobs: Jobs = 1,
    cluster: Cluster = "",
    shard: Annotated[str, typer.Option(help="k/n: every n-th submission from the k-th; `merge` joins them.")] = "1/1",
    only: Annotated[str, typer.Option(help="Grade this student again, and nobody else.")] = "",
    tier: Tier = "",
    rubric: RubricFile = None,
    overrides: Overrides = None,
    times: Times = None,
    due: Due = "",
    unsafe_no_sandbox: Annotated[bool, typer.Option("--unsafe-no-sandbox", help="Run code of others as you.")] = False,
) -> int:
    """Grade submissions in sandboxes; the same command goes on where it was stopped."""
    from grading.grade import grade_class
    from grading.job import Limits
    from grading.late import late_shares
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
    late = late_shares(times, due, rules.late)
    with prepared(rules, secret, chosen, Limits()) as room:
        rows, lost = grade_class(
            folder, out, room, jobs=jobs, cluster=cluster, shard=(index, count), only=only, overrides=changed, late=late
        )
    students = {row["student_id"] for row in rows}
    print(f"{len(students)} submissions graded in tier {chosen}: {out}")
    if count == 1:
        _name_strangers(students, changed, late)
    if lost:
        print(f"{lost} stayed ungraded; the same command tries them again", file=sys.stderr)
    return 1 if lost else 0


@app.command()
def example(
    out: Annotated[Path | None, typer.Option(help="Folder of results and tables; none is kept if empty.")] = None,
    jobs: Jobs = 1,
    cluster: Cluster = "",
    tier: Tier = "",
    update: Annotated[bool, typer.Option("--update", help="Make the class and its expected table anew.")] = False,
) -> int:
    """Grade the example class and compare its table with the expected one."""
    import tempfile

    from grading.example import differences, grade_example
    from grading.folders import own_prefix

    with tempfile.TemporaryDirectory(prefix=own_prefix()) as folder:  # swept where we are killed
        table = grade_example(out or Path(folder) / "grades", jobs=jobs, cluster=cluster, tier=tier, update=update)
    wrong = differences(table)
    for line in wrong:
        print(f"DIFFERS: {line}")
    print(
        f"{len(wrong)} rows differ from grading/example/grades.csv"
        if wrong
        else "grading/example/grades.csv, row by row"
    )
    return 1 if wrong else 0


@app.command()
def generate(
    count: Annotated[int, typer.Argument(min=1, max=5000, help="How many students.")],
    folder: Annotated[Path, typer.Argument(help="A new folder for what they hand in.")],
) -> int:
    """Hand in for a class of any size, to see how long grading takes here; its end says with which rubric."""
    from grading.example import hand_in_many

    rubric = hand_in_many(count, folder)
    print(f"{count} submissions: {folder}; grade them with --rubric {rubric}")
    return 0


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
    from grading.late import late_shares
    from grading.rubric import RUBRIC, load_rubric
    from grading.tables import read_overrides

    rules = load_rubric(rubric or RUBRIC)
    changed, late = read_overrides(overrides, rules), late_shares(times, due, rules.late)
    students = {row["student_id"] for row in join(folders, out, rules, changed, late)}
    print(f"{len(students)} submissions: {out}")
    _name_strangers(students, changed, late)
    return 0


def _name_strangers(
    students: set[str], changed: dict[tuple[str, str], tuple[float, str]], late: dict[str, float]
) -> None:
    """Say whom the corrections and times name who handed nothing in: a mistyped id would lose its line unseen."""
    for what, named in (("--overrides", {student for student, _ in changed}), ("--times", set(late))):
        if strangers := sorted(named - students):
            print(f"{what} names {len(strangers)} who handed nothing in: {', '.join(strangers[:5])}", file=sys.stderr)


@app.command()
def export(
    system: Annotated[str, typer.Argument(help="moodle, canvas, gradescope or nbgrader.")],
    template: Annotated[Path | None, typer.Argument(help="The table exported there; Gradescope needs none.")] = None,
    grades: Annotated[Path, typer.Option(help="Folder that `grade` wrote.")] = Path("grades"),
    column: Annotated[str, typer.Option(help="Column that takes the points, where the name is yours.")] = "",
    lang: Annotated[str, typer.Option(help="en or zh, of Gradescope's lines.")] = "en",
) -> int:
    """Points into a table exported from the course's system: joined by id, everything else kept."""
    from grading.feedback import WORDS, line_of
    from grading.lms import fill, gradescope_results, read_rows, results_json, totals
    from grading.store import write_whole

    rows = read_rows(grades)
    if lang not in WORDS:
        raise UnusableInput(f"unknown language '{lang}'; known: {', '.join(WORDS)}")
    if template is None:
        if system != "gradescope":
            raise UnusableInput(f"{system} needs a template: the table exported there")
        found = gradescope_results(rows, lambda row: line_of(row, lang))
        for student, result in found.items():
            write_whole(grades / "gradescope" / student / "results.json", results_json(result))
        print(f"{len(found)} results.json: {grades / 'gradescope'}")
        return 0
    try:
        content = template.read_bytes()
    except OSError as error:
        raise UnusableInput(f"{template}: cannot be read: {error.strerror}") from None
    filled, missing = fill(system, content, totals(rows), column)
    write_whole(grades / f"{system}.csv", filled)
    print(f"filled: {grades / f'{system}.csv'}")
    if missing:
        print(f"{len(missing)} graded students stand in no row of the template", file=sys.stderr)
    return 1 if missing else 0


@app.command()
def release(
    out: Annotated[
        Path | None, typer.Argument(help="A new folder for the student version; none is kept if empty.")
    ] = None,
    key: Key = None,
    tier: Tier = "",
    rubric: RubricFile = None,
) -> int:
    """The dry run: reference, mutants, policies, attacks; then the student version, looked through for solutions."""
    import tempfile

    from dualnav_lite import course
    from dualnav_lite.exercises import stub
    from grading.dry_run import dry_run
    from grading.job import Limits
    from grading.left_behind import left_behind
    from grading.room import NOTEBOOKS, prepared
    from grading.rubric import RUBRIC, load_rubric
    from grading.secret import Secret, load_secret
    from grading.tiers import choose_tier

    rules = load_rubric(rubric or RUBRIC)
    secret = load_secret(key, rules.assignment) if key else Secret(b"of the dry run alone".ljust(32), rules.assignment)
    with prepared(rules, secret, choose_tier(wanted=tier), Limits()) as room:
        problems = dry_run(room)
    with tempfile.TemporaryDirectory(prefix="dualnav-release-") as folder:
        made = course.release(out or Path(folder) / "course")
        problems += left_behind(made, NOTEBOOKS, stub, key.read_bytes() if key else b"")
        print("student version: looked through" + (f"; it is in {out}" if out else ""))
    for problem in problems:
        print(f"FAILS: {problem}")
    print("nothing stands against it" if not problems else f"{len(problems)} things stand against it")
    return 1 if problems else 0


def main(arguments: list[str] | None = None) -> int:
    """Run a command and give its exit code; what cannot be used ends in one line on stderr and code 2."""
    try:
        code = app(arguments, standalone_mode=False) or 0
    except (UnusableInput, typer.TyperException) as error:
        message = getattr(error, "format_message", error.__str__)()
        print(f"error: {' '.join(message.split())}", file=sys.stderr)
        return 2
    except OSError as error:  # a full disk for temporary files; a path would tell a name
        print(f"error: this machine refuses: {error.strerror or 'a file cannot be copied'}", file=sys.stderr)
        return 2
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    if code == INTERRUPTED:  # typer turns Ctrl-C into this code by itself, without a word
        print("\ninterrupted; the same command goes on from here", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
