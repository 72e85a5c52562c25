"""Running a notebook by papermill, with checked parameters; nothing here is imported that its kernel does not need."""

import logging
from pathlib import Path
from typing import IO, Any

from dualnav_lite.config import UnusableInput, write_atomic


def run_notebook(notebook: Path, output: Path, parameters: dict[str, Any], progress: IO[str] | None = None) -> None:
    """Run a notebook from its first cell to its last by papermill and keep the executed copy.

    papermill only warns of a misspelt parameter and runs with the default, so names are compared first.

    Args:
        parameters: a value for each name in the cell tagged `parameters`, no more and no fewer.
        progress: where the notebook's stderr (progress bars) goes while it runs.

    Raises:
        UnusableInput: no cell tagged `parameters`, or other names than its.
        papermill.PapermillExecutionError: a cell raised; the executed copy shows where.
    """
    import papermill

    known = papermill.inspect_notebook(str(notebook))
    if not known:
        raise UnusableInput(f"{notebook.name}: no cell is tagged 'parameters'")
    wrong = sorted(set(parameters) ^ set(known))
    if wrong:
        problem = "unknown" if wrong[0] in parameters else "missing"
        raise UnusableInput(f"{notebook.name}: {problem} parameter '{wrong[0]}'; known: {', '.join(sorted(known))}")
    output.parent.mkdir(parents=True, exist_ok=True)
    logging.getLogger("papermill").setLevel(logging.CRITICAL)  # what it has to say also comes as an exception
    try:
        papermill.execute_notebook(
            str(notebook),
            str(output),
            parameters=parameters,
            kernel_name="python3",
            cwd=str(output.parent),
            progress_bar=False,
            stderr_file=progress,
            shutdown_kernel="immediate",  # one that is asked to end is interrupted first, and prints that
            extra_arguments=["--IPKernelApp.log_level=ERROR"],  # each kernel warns of TCP, which stays on this machine
        )
    except KeyboardInterrupt:
        logging.getLogger("asyncio").setLevel(logging.CRITICAL)  # the kernel died, as it should
        raise
    _settle_progress(output)


def _settle_progress(output: Path) -> None:
    """Leave of each progress bar in the executed copy its last state, as a terminal would."""
    import nbformat

    notebook = nbformat.read(output, as_version=4)
    for cell in notebook.cells:
        for part in cell.get("outputs", []):
            if part.output_type == "stream" and part.name == "stderr":
                lines = (line.rstrip("\r").rpartition("\r")[2] for line in part.text.split("\n"))
                part.text = "\n".join(line for line in lines if line)
    write_atomic(output, nbformat.writes(notebook) + "\n")
