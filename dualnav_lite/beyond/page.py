"""The tables of `stress_tests/reference/beyond/README.md`, written from the CSVs beside it; its sentences are not."""

import re
from pathlib import Path

import pandas as pd

from dualnav_lite.config import UnusableInput, write_atomic
from dualnav_lite.report import markdown

PAGE = "README.md"
BLOCK = re.compile(r"(<!-- (\w+)\.csv -->\n).*?(<!-- end -->)", re.DOTALL)
RATE = "{survival_rate:.2f} [{wilson_low:.3f}, {wilson_high:.3f}]"
# Of each table: headers, and one format a column of the values of a row.
COLUMNS: dict[str, dict[str, str]] = {
    "crowdnav": {
        "setting": "{setting}",
        "people": "{people}",
        "arm": "`{arm}`",
        "knows": "{knows}",
        "judged with a hull of [m]": "{judged_with_m}",
        "success": "{success_rate:.3f} [{wilson_low:.3f}, {wilson_high:.3f}]",
        "as published": "{known_success}",
        "collision": "{collision_rate:.3f}",
        "out of time": "{timeout_rate:.3f}",
        "time [s]": "{mean_time_s:.1f}",
    },
    "streets": {
        "arm": "`{arm}`",
        "training seed": "{training_seed}",
        "preference": "{preference}",
        "arrives": "{arrived_rate:.2f} [{wilson_low:.3f}, {wilson_high:.3f}]",
        "excess": "{mean_excess:.2%} [{excess_low:.2%}, {excess_high:.2%}]",
    },
    "onboard": {
        "scenario": "{scenario}",
        "frames": "{frames}",
        "frames a second": "{frames_per_s:.0f}",
        "median [ms]": "{p50_ms:.1f}",
        "99 % [ms]": "{p99_ms:.1f}",
        "largest difference of a command": "{most_different:g}",
        "folder [MB]": "{folder_mb:.1f}",
    },
    "parking": {
        "arm": "`{arm}`",
        "training seed": "{training_seed}",
        "parked": RATE,
        "touched a wall": "{collisions}",
        "out of time": "{timeouts}",
        "energy [kJ]": "{energy_kj:.0f} [{energy_low:.0f}, {energy_high:.0f}]",
        "time [s]": "{mean_time_s:.1f}",
    },
    "traffic": {
        "arm": "`{arm}`",
        "training seed": "{training_seed}",
        "preference": "{preference}",
        "arrives": RATE,
        "hit": "{collisions}",
        "out of time": "{timeouts}",
        "least gap [m]": "{safe_dist_m:.1f} [{safe_low:.1f}, {safe_high:.1f}]",
        "energy [kJ]": "{energy_kj:.0f} [{energy_low:.0f}, {energy_high:.0f}]",
        "time [s]": "{mean_time_s:.1f}",
    },
    "fleet": {
        "robots": "{robots}",
        "weight": "{cross_weight}",
        "arrived": "{robots_arrived} [{wilson_low:.3f}, {wilson_high:.3f}]",
        "hit each other": "{hit_robot}",
        "off the predicted way [m]": "{deviation_m:.3f} [{deviation_low:.3f}, {deviation_high:.3f}]",
        "energy a robot [J]": "{energy_j_per_robot:.0f}",
    },
    "algorithms": {
        "algorithm": "{algorithm}",
        "training seed": "{training_seed}",
        "survived": RATE,
        "hit": "{collisions}",
        "out of time": "{timeouts}",
        "contacts while learning": "{learning_collisions}",
        "in the first third": "{learning_collisions_early}",
        "acceleration [m/s2]": "{accel_rms:.2f} [{accel_low:.2f}, {accel_high:.2f}]",
        "turns a second": "{turns_a_second:.2f} [{turns_low:.2f}, {turns_high:.2f}]",
    },
}


class _Nothing:
    """A value that is not there: empty in whatever format."""

    def __format__(self, spec: str) -> str:
        return ""


def table_lines(name: str, table: pd.DataFrame) -> list[str]:
    """Lines of Markdown: the columns of `COLUMNS[name]`, a row each."""
    headers, formats = list(COLUMNS[name]), list(COLUMNS[name].values())
    rows = [
        {key: _Nothing() if pd.isna(value) else value for key, value in row.items()}
        for row in table.astype(object).to_dict("records")
    ]
    return markdown(tuple(headers), [tuple(text.format(**row) for text in formats) for row in rows])


def write_page(folder: str | Path) -> Path | None:
    """Fill each block of the folder's page from its CSV; None where the folder has no page.

    Raises:
        UnusableInput: a block names a table that is not there or not known.
    """
    page = Path(folder) / PAGE
    if not page.exists():
        return None

    def filled(match: re.Match) -> str:
        name, path = match[2], Path(folder) / f"{match[2]}.csv"
        if name not in COLUMNS or not path.exists():
            raise UnusableInput(f"{page}: a block for '{name}.csv', and there is no such table")
        table = pd.read_csv(path, encoding="utf-8").convert_dtypes()
        return match[1] + "\n".join(["", *table_lines(name, table), ""]) + "\n" + match[3]

    write_atomic(page, BLOCK.sub(filled, page.read_text(encoding="utf-8")))
    return page
