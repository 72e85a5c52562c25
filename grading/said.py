"""What a student's cells said when they were run, before anything hidden was asked; for feedback, never scored."""

import json
import re

MOST_LINES, MOST_LINE = 12, 160
COLOURS = re.compile(r"\x1b\[[0-9;]*[A-Za-z]")
PLACE = re.compile(r"solution-([0-9]{1,4})")  # ids that `rebuild.rebuilt` gives


def said_by(executed: bytes, order: tuple[tuple[str, str], ...]) -> dict[str, str]:
    """Printed lines and the error of each exercise's cell, where there are any.

    Args:
        executed: the notebook as it came out of the sandbox, which may be anything.
        order: of `rebuild.Master`.
    """
    try:
        cells = json.loads(executed.decode("utf-8"))["cells"]
        found = {cell["id"]: _lines(cell["outputs"]) for cell in cells if PLACE.fullmatch(cell["id"])}
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return {}
    texts = {}
    for name, lines in found.items():
        place = int(name.partition("-")[2])
        if lines and place < len(order) and order[place][0] == "solution":
            left = len(lines) - MOST_LINES
            texts[order[place][1]] = "\n".join([*lines[:MOST_LINES], *(["..."] if left > 0 else [])])
    return texts


def _lines(outputs: list[dict]) -> list[str]:
    """Text of a cell's outputs, line by line; of a traceback only what it ends with."""
    text = ""
    for output in outputs:
        if output["output_type"] == "stream":
            text += "".join(output["text"])
        elif output["output_type"] == "error":
            text += f"\n{output['ename']}: {output['evalue']}\n"
    plain = COLOURS.sub("", text)
    lines = ["".join(c for c in line if c.isprintable())[:MOST_LINE] for line in plain.split("\n")]
    return [line for line in lines if line.strip()]
