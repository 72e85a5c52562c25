"""What an evaluation is cut into, and what it leaves: chunks with a name of their own, what made them, rows merged."""

import csv
import hashlib
import io
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from dualnav_lite import __version__
from dualnav_lite.config import Config, dump_config
from dualnav_lite.episodes import COLUMNS
from dualnav_lite.scenario import Scenario

CHUNK_EPISODES = 50
CHUNK_LONG_RUNS = 5  # a three-hour run is as long as 700 short ones
KEY = ("scenario", "arm", "training_seed", "preference", "seed")  # order of the rows in `episodes.csv`
ABLATION = "ablation_"  # what the arms of `models/ablations` begin with
PARTS_MARK = "::"  # between an arm and the folder of a student's parts
NAME_LENGTH = 40  # characters of an arm in a file's name: some are paths, and a name has room for 255 bytes


@dataclass(frozen=True)
class Chunk:
    """Episodes that are run, written and resumed as one."""

    scenario: Scenario
    arm: str
    seeds: tuple[int, ...]
    path: Path

    def is_done(self) -> bool:
        """Whether its file holds a row for each seed."""
        try:
            rows = list(csv.reader(io.StringIO(self.path.read_text(encoding="utf-8"))))
        except (OSError, UnicodeDecodeError):
            return False
        seed = list(COLUMNS).index("seed")
        return rows[:1] == [list(COLUMNS)] and [row[seed] for row in rows[1:]] == [str(s) for s in self.seeds]


def arm_name(arm: str) -> str:
    """What rows and tables call an arm: its id, but for an arm with a student's parts, whose id holds absolute paths.

    >>> arm_name("/course/parts/ppo_actor.onnx::/course/parts")
    'ppo_actor + own parts'
    >>> arm_name("astar@max_speed=0.5")
    'astar@max_speed=0.5'
    """
    base, mark, folder = arm.partition(PARTS_MARK)
    if not mark:
        return arm
    lies_inside = Path(base).parent == Path(folder)
    return f"{Path(base).stem if lies_inside else base} + own parts"


def sha256(text: str | bytes) -> str:
    """Hexadecimal SHA-256 of a text (as UTF-8) or of bytes."""
    return hashlib.sha256(text.encode("utf-8") if isinstance(text, str) else text).hexdigest()


# What lies above `evaluate` and tells, draws or teaches: imports only go down, so no row depends on it.
ABOVE_ROWS = (
    "__main__.py", "beyond", "check", "claims.py", "commands", "course.py", "doctor.py", "figures", "judge.py",
    "model_card.py", "pace.py", "pages.py", "policy_tables.py", "publish.py", "report.py", "stress.py",
    "study_tables.py", "submission.py",
)  # fmt: skip


@cache
def code_sha256() -> str:
    """One hash of every source file that rows can depend on, so that no chunk outlives the code that made it."""
    root = Path(__file__).parent
    files = sorted(root.rglob("*.py"), key=lambda path: path.relative_to(root).as_posix())
    files = [path for path in files if path.relative_to(root).parts[0] not in ABOVE_ROWS]
    return sha256("".join(sha256(path.read_bytes().replace(b"\r\n", b"\n")) for path in files))


def plan_chunks(arms: dict[str, str], scenarios: Sequence[Scenario], seeds: Sequence[int], config: Config, out: Path):
    """The chunks of an evaluation, the same list whatever the number of workers, worlds and shards.

    A chunk's file is `<scenario>.<arm>.<first seed>.<hash>.csv`; the hash covers the resolved config, the scenario, the
    arm and its fingerprint, the seeds and the package's code, so a changed setting never meets an old chunk.

    Args:
        arms: arm id to the fingerprint of what stands behind it (weights' SHA-256; empty for planners).
    """
    code, chunks = code_sha256(), []
    for scenario in scenarios:
        size = CHUNK_LONG_RUNS if scenario.dispatcher else CHUNK_EPISODES
        for arm, fingerprint in arms.items():
            for first in range(0, len(seeds), size):
                part = tuple(seeds[first : first + size])
                name = arm_name(arm)
                made_of = [dump_config(config), dump_config(scenario), name, fingerprint, part, code, list(COLUMNS)]
                stem = f"{scenario.id}.{name[-NAME_LENGTH:]}.{part[0]}.{sha256(json.dumps(made_of))[:12]}"
                stem = re.sub(r"[^\w.-]", "_", stem)
                chunks.append(Chunk(scenario, arm, part, out / "chunks" / f"{stem}.csv"))
    return chunks


def run_json(fingerprints, scenarios, seeds, config) -> str:
    """What produced the rows beside it."""
    content = {
        "kit_version": __version__,
        "code_sha256": code_sha256(),
        "config_sha256": sha256(dump_config(config)),
        "config": config.model_dump(mode="json"),
        "scenarios": {scenario.id: scenario.model_dump(mode="json") for scenario in scenarios},
        "policy_sha256": {arm_name(arm): fingerprint for arm, fingerprint in fingerprints.items()},
        "seeds": {"first": seeds[0], "last": seeds[-1], "count": len(seeds)},
    }
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def merged(chunks: Sequence[Chunk]) -> bytes:
    """All rows of the chunks under one header, sorted by `KEY`."""
    rows = []
    for chunk in chunks:
        with open(chunk.path, encoding="utf-8", newline="") as file:
            rows += list(csv.DictReader(file))
    rows.sort(key=lambda row: [row[name] if name in KEY[:2] else float(row[name] or -1) for name in KEY])
    text = io.StringIO()
    writer = csv.DictWriter(text, list(COLUMNS), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode("utf-8")
