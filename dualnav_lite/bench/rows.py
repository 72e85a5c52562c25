"""Lines of the benchmark's table: what was measured, in which unit, and whether it is fast enough."""

import csv
import io
from dataclasses import dataclass

NOT_INSTALLED = "not installed"


@dataclass(frozen=True)
class Row:
    """One line of the table; `value` is None where the peer is not installed.

    Attributes:
        first_target, aim: of SPEC 11, in the same unit; None where it names none.
        peer: package and version that the row is about.
    """

    what: str
    value: float | None
    unit: str
    first_target: float | None = None
    aim: float | None = None
    peer: str = ""
    smaller_is_better: bool = False

    @property
    def verdict(self) -> str:
        """Whether the value reaches the aim, the first target or neither; empty where there is nothing to reach."""
        if self.value is None or self.first_target is None:
            return ""
        sign = -1 if self.smaller_is_better else 1
        if self.aim is not None and sign * self.value >= sign * self.aim:
            return "reaches aim"
        return "reaches target" if sign * self.value >= sign * self.first_target else "below"


def row_line(row: Row) -> str:
    """A row of the printed table."""
    value = NOT_INSTALLED if row.value is None else f"{row.value:,.{0 if row.value >= 100 else 1}f} {row.unit}"
    limits = "" if row.first_target is None else f"first target {row.first_target:,g}"
    limits += "" if row.aim is None else f", aim {row.aim:,g}"
    return f"{row.what:<60} {value:>14}  {row.verdict:<14} {limits}".rstrip()


def rows_csv(rows: list[Row]) -> str:
    """Text of `bench.csv`."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["what", "value", "unit", "first_target", "aim", "verdict", "peer"])
    for row in rows:
        value = "" if row.value is None else f"{row.value:.6g}"
        limits = ["" if limit is None else limit for limit in (row.first_target, row.aim)]
        writer.writerow([row.what, value, row.unit, *limits, row.verdict, row.peer])
    return text.getvalue()
