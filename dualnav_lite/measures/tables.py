"""Measurements beside the survival table, by name: each a command, a few CSVs and the defaults that SPEC asks for."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from dualnav_lite.config import UnusableInput, write_atomic
from dualnav_lite.episodes import SEEDS
from dualnav_lite.judge import ABLATION_DEFAULT, csv_text
from dualnav_lite.judge import ablations as ablation_tables
from dualnav_lite.report import frame_texts

MOST_ROWS = 60  # of a table that a person reads


@dataclass(frozen=True)
class Options:
    """What a measurement is given.

    Attributes:
        arms, scenarios: ids; empty for the measurement's own.
        episodes: seeds of each; 0 for the measurement's own number.
        seed_base: first seed; jobs: worker processes; out: folder of the CSVs.
    """

    out: Path
    arms: Sequence[str] = ()
    scenarios: Sequence[str] = ()
    episodes: int = 0
    seed_base: int = SEEDS["test"].start
    jobs: int = 1

    @property
    def arm(self) -> str:
        """The one that measurements of a single arm look at."""
        return self.arms[0] if self.arms else "ppo"

    def seeds(self, count: int) -> range:
        """As many as were asked for, else `count`."""
        return range(self.seed_base, self.seed_base + (self.episodes or count))


def front(options: Options) -> dict[str, pd.DataFrame]:
    """Preferences of the policy and the top speed of four planners: `pareto.csv`, `front.csv`, `trade.csv`."""
    from dualnav_lite.measures.sweep import sweep
    from dualnav_lite.pareto import front, pareto, trade

    rows = sweep(options)
    return {"sweep": rows, "pareto": pareto(rows), "front": front(rows), "trade": trade(rows)}


def intervention(options: Options) -> dict[str, pd.DataFrame]:
    """The battery band alone flipped between 15 and 100 %, and whole runs begun at either: `intervention.csv`."""
    from dualnav_lite.measures.intervention import intervention

    return {"intervention": intervention(options)}


def latency(options: Options) -> dict[str, pd.DataFrame]:
    """Wall-clock of the stages of a step, and ticks until a pop-up is answered: `latency.csv`, `response_ticks.csv`."""
    from dualnav_lite.measures.latency import latency_table, response_ticks

    ticks = response_ticks(options)
    return {"latency": latency_table(options, ticks), "response_ticks": ticks}


def motion(options: Options) -> dict[str, pd.DataFrame]:
    """Endpoint error of each motion method, standing and driving, and gains: `motion_error.csv`, `..._paired.csv`."""
    from dualnav_lite.measures.motion_error import episode_errors, error_table, paired_table

    episodes = episode_errors(options)
    return {"motion_error": error_table(episodes), "motion_error_paired": paired_table(episodes)}


def battery_trace(options: Options) -> dict[str, pd.DataFrame]:
    """Charge, goals and contacts over three hours, once a simulated minute: `battery_trace.csv`."""
    from dualnav_lite.measures.battery_hours import battery_trace

    return {"battery_trace": battery_trace(options)}


def perturb(options: Options) -> dict[str, pd.DataFrame]:
    """Commands changed within bounds, by evolution and by chance: `perturbed_front.csv`, `perturbed_gain.csv`."""
    from dualnav_lite.measures.perturb import perturbed_front

    points, gain = perturbed_front(options)
    return {"perturbed_front": points, "perturbed_gain": gain}


def find_failures(options: Options) -> dict[str, pd.DataFrame]:
    """Scenario settings in which the policy fails, searched against random search: `failure_search.csv`."""
    from dualnav_lite.measures.failures import failure_search

    return {"failure_search": failure_search(options)}


def ablations(options: Options) -> dict[str, pd.DataFrame]:
    """Every ablation that was trained, beside the default trained alike: `ablations.csv`, `ablations_paired.csv`."""
    from dualnav_lite.drivers import trained_ablations
    from dualnav_lite.evaluate import evaluate

    arms = list(options.arms or trained_ablations())
    if ABLATION_DEFAULT not in arms:
        raise UnusableInput(f"ablations are held against {ABLATION_DEFAULT}, which is not in models/ablations yet")
    scenarios = options.scenarios or ("navigation", "pop_up", "crowd_crossing", "low_light_phantoms", "comms_dropout")
    rows = evaluate(arms, scenarios, options.seeds(200), options.out / "ablations", jobs=options.jobs)
    return ablation_tables(rows)


MEASURES: dict[str, Callable[[Options], dict[str, pd.DataFrame]]] = {
    measure.__name__: measure
    for measure in (front, intervention, latency, motion, battery_trace, ablations, perturb, find_failures)
}


def run(name: str, options: Options) -> dict[str, pd.DataFrame]:
    """Measure and write `<table>.csv` into `options.out`, short ones as LaTeX and Markdown too; returns the tables.

    Raises:
        UnusableInput: an unknown name, arm or scenario, or a folder that refuses.
    """
    if name not in MEASURES:
        raise UnusableInput(f"unknown measurement '{name}'; known: {', '.join(MEASURES)}")
    tables = MEASURES[name](options)
    for table, content in tables.items():
        write_atomic(options.out / f"{table}.csv", csv_text(content))
        if len(content) <= MOST_ROWS:
            for name, text in frame_texts(table, content).items():
                write_atomic(options.out / name, text)
    return tables
