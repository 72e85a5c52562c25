"""The course: its notebooks, the student version, and what is handed in."""

from pathlib import Path
from typing import Annotated

import typer

from dualnav_lite.commands import CORES, Jobs, app
from dualnav_lite.config import UnusableInput

Lang = Annotated[str | None, typer.Option(help="en or zh; what the lessons were set to, else $DUALNAV_LANG.")]
LESSONS = "Folder with your notebooks; course/ (`lab --student`) if not given and there, else notebooks/."


def lessons_in(folder: Path | None) -> Path:
    """The folder that was named, or the one that a student works in here.

    Raises:
        UnusableInput: there is none.
    """
    found = folder or next((Path(name) for name in ("course", "notebooks") if Path(name).is_dir()), Path("notebooks"))
    if not found.is_dir():
        raise UnusableInput(f"{found}: no such folder")
    return found


@app.command()
def notebooks(
    check: Annotated[bool, typer.Option("--check", help="Change nothing; exit 1 where something differs.")] = False,
    take_back: Annotated[str, typer.Option(help="Bring an edit made in JupyterLab into the source, as in 00.")] = "",
) -> int:
    """Rebuild every notebook from its source in src/."""
    from dualnav_lite import notebooks as pipeline

    if take_back:
        print(f"taken back into src/{pipeline.take_back(take_back).name}")
        return 0
    changed = pipeline.rebuild(check=check)
    for path in changed:
        print(f"{'differs from its source' if check else 'rebuilt'}: {path.parent.name}/{path.name}")
    if not changed:
        print("every notebook is what its source makes")
    return 1 if check and changed else 0


@app.command()
def release(
    out: Annotated[Path, typer.Argument(help="A folder that is not there yet.")],
    lessons_only: Annotated[
        bool, typer.Option("--lessons-only", help="The notebooks alone; keeps those there.")
    ] = False,
) -> int:
    """The student version: stubs in place of solutions, the library whole."""
    from dualnav_lite import course

    if lessons_only:
        written = course.write_lessons(out)
        print(f"{len(written)} lessons written to {out}" if written else f"every lesson is in {out} already")
        return 0
    print(f"student version: {course.release(out)}")
    return 0


@app.command()
def status(
    folder: Annotated[Path | None, typer.Argument(help=LESSONS)] = None,
    export: Annotated[Path | None, typer.Option(help="Write your parts here, for `stress --parts`.")] = None,
    lang: Lang = None,
) -> int:
    """Which exercises pass, and whose part is used for each; with --export, your parts as a folder."""
    from dualnav_lite import parts

    folder = lessons_in(folder)
    if export and not parts.has_lessons(folder):
        raise UnusableInput(f"{folder}: no lesson of the course lies there")
    parts.status(folder, lang, export)
    return 0


@app.command()
def submit(
    student: Annotated[str, typer.Argument(help="Your id, as your teacher knows it.")],
    folder: Annotated[Path | None, typer.Option(help=LESSONS)] = None,
    out: Annotated[Path | None, typer.Option(help="submission_STUDENT if not given.")] = None,
    episodes: Annotated[int, typer.Option(min=0, help="Runs of each scenario; 0 leaves them out.")] = 50,
    jobs: Jobs = CORES,
    lang: Lang = None,
) -> int:
    """Check your notebooks, pack the folder that is handed in, drive your policy and say what to expect elsewhere."""
    from dualnav_lite import submission
    from dualnav_lite.check.verdict import LANGUAGES, language_of

    folder = lessons_in(folder)
    target = submission.pack(folder, student, out or Path(f"submission_{student}"), lang=lang)
    if episodes:
        submission.try_out(folder, target, episodes, jobs=jobs, lang=lang)
    print(submission.HAND_IN[LANGUAGES.index(language_of(lang, folder))].format(folder=target))
    return 0
