"""Scenario settings in which the policy fails, searched by evolution and by chance, and run again on fresh seeds."""

from contextlib import suppress
from functools import partial
from pathlib import Path

import pandas as pd

from dualnav_lite.config import UnusableInput, dump_config, with_overrides
from dualnav_lite.measures.adversary import BUDGET, EACH, FRESH_SEED, SEARCH_SEED, episodes_of, search
from dualnav_lite.measures.kept import all_kept, fingerprint
from dualnav_lite.measures.tables import Options
from dualnav_lite.metrics import exact_interval
from dualnav_lite.pareto import safe_distance
from dualnav_lite.scenario import load_scenario
from dualnav_lite.survival import survived

CANNOT_BE = 2.0  # loss of settings without a layout; a run without failures loses less
# Settings of each scenario that are searched, and how far: round what the scenario file says, within what can be met.
SETTINGS = {
    "pop_up": {
        "pop_up.speed_m_s": (0.8, 2.2),
        "pop_up.ahead_m": (1.5, 2.4),
        "pop_up.passage_m": (0.7, 1.0),
        "people.speed_m_s.high": (0.5, 1.4),
    },
    "crowd_crossing": {
        "crowd.speed_m_s": (0.5, 1.3),
        "crowd.gap_m.high": (0.2, 0.9),
        "crowd.aim_error_s": (0.0, 1.2),
        "crowd.lead_s.low": (0.8, 3.0),
    },
}
FAILURE_COLUMNS = [
    "scenario", "method", "episodes", "failures", "failure_rate", "worst_settings", "worst_rate_in_search",
    "fresh_episodes", "fresh_failures", "default_failures_on_fresh", "fresh_survival_rate",
    "exact_low", "exact_high",
]  # fmt: skip


def failures_found(folder: Path, name: str, arm: str, method: str, budget: int) -> pd.DataFrame:
    """The row of `failure_search.csv` of one scenario and method."""
    fresh, keys = min(200, budget), list(SETTINGS[name])
    default = int((~survived(episodes_of(folder, load_scenario(name), arm, FRESH_SEED, fresh))).sum())
    tried: list[tuple] = []

    def loss(values) -> float:
        changed = with_overrides(load_scenario(name), dict(zip(keys, map(float, values), strict=True)))
        try:
            rows = episodes_of(folder, changed, arm, SEARCH_SEED, EACH)
        except UnusableInput:
            return CANNOT_BE  # no room can hold this event: not a failure of the robot
        failures = int((~survived(rows)).sum())
        clearance = float(safe_distance(rows).mean())
        tried.append((failures, -clearance, changed, values))
        return clearance - failures / EACH

    search(loss, list(SETTINGS[name].values()), max(1, budget // EACH), 0, method)
    if not tried:
        raise UnusableInput(f"{name}: in {budget} episodes {method} search met no settings that can be")
    for worst in sorted(tried, key=lambda one: one[:2], reverse=True):
        with suppress(UnusableInput):  # a room of a fresh seed cannot hold them: the next worst
            again = int((~survived(episodes_of(folder, worst[2], arm, FRESH_SEED, fresh))).sum())
            break
    else:
        raise UnusableInput(f"{name}: {method} search met no settings that every fresh seed has a room for")
    failures, episodes = sum(one[0] for one in tried), EACH * len(tried)
    described = "; ".join(f"{key} {value:.3g}" for key, value in zip(keys, worst[3], strict=True))
    found = [failures, failures / episodes, described, worst[0] / EACH]
    row = [
        name,
        method,
        episodes,
        *found,
        fresh,
        again,
        default,
        1 - again / fresh,
        *exact_interval(fresh - again, fresh),
    ]
    return pd.DataFrame([row], columns=FAILURE_COLUMNS)


def failure_search(options: Options) -> pd.DataFrame:
    """`failure_search.csv`: how many failures each method finds in the same number of episodes, and whether they stay.

    The settings with the most failures are run again on fresh seeds, and so is the scenario as it is; where a fresh
    seed has no room that holds them, the next worst settings are.
    """
    arm, budget = options.arm, options.episodes or BUDGET
    folder, tasks = options.out / "failures", {}
    for name in options.scenarios or SETTINGS:
        if name not in SETTINGS:
            raise UnusableInput(f"no settings of '{name}' are searched; known: {', '.join(SETTINGS)}")
        for method in ("evolution", "random"):
            made_of = [dump_config(load_scenario(name)), arm, fingerprint(arm), method, budget]
            tasks[f"{name}.{method}"] = made_of, partial(failures_found, folder, name, arm, method, budget)
    return all_kept(folder, tasks, options.jobs)
