"""The commands: `python -m dualnav_lite --help`. Exit codes: 0 done, 1 something stayed undone, 2 unusable input."""

import sys
from typing import Annotated

import typer

from dualnav_lite import __version__
from dualnav_lite.commands import app, learning, machine, measuring, suite, teaching
from dualnav_lite.config import UnusableInput

GROUPS = (suite, measuring, learning, teaching, machine)  # importing them has filled the app
INTERRUPTED = 130


@app.callback(invoke_without_command=True)
def common(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and end.")] = False,
) -> None:
    """dualnav-lite: robot navigation by reinforcement learning, safe and thrifty at once.

    Exit codes: 0 done, 1 a result falls short or something stayed undone, 2 unusable input.
    """
    if version:
        print(__version__)
    elif context.invoked_subcommand is None:
        print(context.get_help())
        raise typer.Exit(2)


def main(arguments: list[str] | None = None) -> int:
    """Run a command and give its exit code; what cannot be used ends in one line on stderr and code 2."""
    try:
        code = app(arguments, standalone_mode=False) or 0
    except (UnusableInput, typer.TyperException) as error:
        message = getattr(error, "format_message", error.__str__)()
        print(f"error: {' '.join(message.split())}", file=sys.stderr)
        return 2
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    if code == INTERRUPTED:  # typer turns Ctrl-C into this code by itself, without a word
        print("\ninterrupted; the same command goes on from here", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
