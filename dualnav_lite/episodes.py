"""The row of an episode: its columns, its outcomes, its text, and who may use which seeds."""

import csv
import io
import math
from collections.abc import Iterable, Mapping

# Columns of `episodes.csv` with the type each is read back as.
COLUMNS = {
    "scenario": "str",
    "arm": "str",
    "training_seed": "Int64",  # empty for arms that were not trained
    "seed": "int64",
    "preference": "float64",
    "outcome": "str",
    "collided_with": "str",
    "events": "Int64",
    "first_event_s": "float64",  # empty where nothing happened
    "steps": "int64",
    "time_s": "float64",
    "path_m": "float64",
    "min_clearance_m": "float64",
    "mean_clearance_m": "float64",
    "energy_j": "float64",
    "battery_end": "float64",
    "goals": "Int64",
    "contacts": "Int64",
    "accel_rms": "float64",
    "omega_sign_changes": "Int64",
    "r_safe": "float64",
    "r_dynamic": "float64",
    "r_energy": "float64",
    "r_goal": "float64",
    "r_terminal": "float64",
    "reason": "str",
}

# Every outcome and the kind that a survival table counts it under.
OUTCOMES = {
    "goal": "survived",
    "survived": "survived",
    "hit_wall": "collision",
    "hit_furniture": "collision",
    "hit_person": "collision",
    "hit_box": "collision",
    "hit_robot": "collision",
    "too_many_contacts": "collision",
    "timeout": "timeout",
    "few_goals": "timeout",
    "flat_battery": "flat_battery",
    "low_charge": "flat_battery",
    "error": "error",  # the arm or the world raised; `reason` says what
}

# Who may use which seeds. `SEEDS["test"][:1000]` are the published ones.
SEEDS = {
    "train": range(0, 1_000_000),
    "tuning": range(1_000_000, 1_100_000),
    "test": range(2_000_000, 3_000_000_001),  # published, never used to choose anything
    "grading": range(3_000_000_001, 2**63),  # drawn from a secret
}


def cell_text(column: str, value) -> str:
    """Text of one value: floats rounded to six decimals in their shortest form, nothing for None and NaN.

    >>> cell_text("time_s", 0.1 + 0.2), cell_text("goals", 1.0), cell_text("first_event_s", float("nan"))
    ('0.3', '1', '')
    """
    kind = COLUMNS[column]
    if value is None or (kind != "str" and math.isnan(value)):
        return ""
    if kind == "str":
        # One ASCII line: the same bytes everywhere, and Excel opens it without being told the encoding.
        return " ".join(str(value).split()).encode("ascii", "backslashreplace").decode("ascii")
    if kind == "float64":
        return repr(round(float(value), 6) + 0.0)  # + 0.0 turns -0.0 into 0.0
    return str(int(value))


def rows_to_csv(rows: Iterable[Mapping]) -> bytes:
    """UTF-8 text of `episodes.csv`: the header, then a line a row, LF line ends on every system.

    Raises:
        ValueError: a row lacks a column, has one too many, or an outcome that is not in `OUTCOMES`.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in rows:
        if set(row) != set(COLUMNS):
            raise ValueError(f"a row's columns are off by {sorted(set(row) ^ set(COLUMNS))}")
        if row["outcome"] not in OUTCOMES:
            raise ValueError(f"unknown outcome {row['outcome']!r}; known: {', '.join(OUTCOMES)}")
        writer.writerow([cell_text(column, row[column]) for column in COLUMNS])
    return text.getvalue().encode("utf-8")
