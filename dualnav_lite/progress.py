"""How a training goes: `log.csv`, and both objectives on the screen."""

import csv
import io
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from dualnav_lite.config import write_atomic

EPISODES_A_REPORT = 100  # the article prints both objectives every 100 episodes


class Log:
    """Numbers of each update as `log.csv`, and lines for whoever watches."""

    def __init__(self, path: Path, say: Callable[[str], None]):
        self._path, self.say = path, say
        self.rows: list[dict[str, Any]] = []
        if path.exists():
            with open(path, encoding="utf-8", newline="") as file:
                self.rows = list(csv.DictReader(file))

    def rewind(self, stage: str, step: int) -> None:
        """Forget what was logged after a checkpoint."""
        kept = []
        for row in self.rows:
            if row["stage"] == stage and int(row["step"]) > step:
                break
            kept.append(row)
        self.rows = kept

    def add(self, stage: str, step: int, numbers: dict[str, Any]) -> None:
        """Append a row and write the file whole."""
        rounded = {k: float(f"{v:.5g}") if isinstance(v, float) else v for k, v in numbers.items()}
        self.rows.append({"stage": stage, "step": step, **rounded})
        text = io.StringIO()
        names = list(dict.fromkeys(name for row in self.rows for name in row))
        writer = csv.DictWriter(text, names, lineterminator="\n", restval="")
        writer.writeheader()
        writer.writerows(self.rows)
        write_atomic(self._path, text.getvalue())


class Reporter:
    """Both objectives over the last episodes, as the article prints them, and how long it will take."""

    def __init__(self, say, total_steps: int, done_steps: int):
        self._say, self._total, self._begin_step = say, total_steps, done_steps
        self._begin = time.monotonic()
        self.episodes = 0
        self._recent: deque[tuple[float, float, bool]] = deque(maxlen=EPISODES_A_REPORT)

    def take(self, infos, step: int) -> None:
        """Count the episodes that ended in a step."""
        if "summary" not in infos:
            return
        summary = infos["summary"]
        for i in np.flatnonzero(infos["_summary"]):
            is_goal = summary["outcome"][i] == "goal"
            self._recent.append((summary["min_clearance_m"][i], summary["energy_j"][i], is_goal))
            self.episodes += 1
            if self.episodes % EPISODES_A_REPORT == 0:
                safe_dist, energy, reached = self.numbers().values()
                self._say(
                    f"Ep {self.episodes}: SafeDist={safe_dist:.2f}m | Energy={energy:.2f}J | reached {reached:.0%} | "
                    f"step {step:,} of {self._total:,}, {self._left(step)} left"
                )

    def _left(self, step: int) -> str:
        done = step - self._begin_step
        seconds = (time.monotonic() - self._begin) / max(done, 1) * (self._total - step)
        return f"{seconds / 60:.0f} min" if seconds >= 90 else f"{seconds:.0f} s"

    def numbers(self) -> dict[str, float]:
        """Means over the last episodes, for the log."""
        if not self._recent:
            return {}
        safe_dist, energy, reached = np.mean(np.array(self._recent, float), axis=0)
        return {"avg_safe_dist": float(safe_dist), "total_energy": float(energy), "reached": float(reached)}
