import numpy as np
import pandas as pd

from dualnav_lite.episodes import COLUMNS
from dualnav_lite.pareto import trade
from dualnav_lite.policy_tables import band_lines, cost_lines, paired_lines, preference_lines, training_lines
from dualnav_lite.survival import rows_of


def runs(arm, survived, episodes=10, **more):
    numbers = {
        "scenario": "pop_up",
        "arm": arm,
        "min_clearance_m": 0.25,
        "energy_j": 30.0,
        "preference": 0.5,
        "steps": 10,
    } | more
    return [
        dict.fromkeys(COLUMNS) | numbers | {"seed": seed, "outcome": "goal" if seed < survived else "hit_box"}
        for seed in range(episodes)
    ]


def cells(line):
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_trainings_stand_beside_the_shipped_policy_and_ppo_beside_what_it_began_from():
    shipped = rows_of(runs("ppo", 9) + runs("ppo_filter", 10) + runs("ppo", 9, scenario="navigation"))
    folder = "models/trainings"
    rows = rows_of(
        runs(f"{folder}/record_seed1.onnx", 8, time_s=9.5, energy_j=31.0)
        + runs(f"{folder}/imitated_seed1.onnx", 5, time_s=10.0)
        + runs(f"{folder}/from_nothing.onnx", 1)
    )
    head, _, counts, _, pairs, _, difference, _, costs, _, cost = training_lines(rows, shipped)
    assert cells(head) == ["scenario", "`ppo`", "`from_nothing`", "`imitated_seed1`", "`record_seed1`"]
    assert cells(counts) == ["pop_up", "9 of 10", "1 of 10", "5 of 10", "8 of 10"]  # no line for what only `ppo` ran
    assert cells(pairs) == ["scenario", "`record_seed1` minus `imitated_seed1`"]
    assert cells(difference)[1].startswith("+30.0 (")
    assert cells(costs)[2] == "`record_seed1` minus `imitated_seed1` [J]"
    assert cells(cost) == ["pop_up", "-0.50 (-0.50 to -0.50)", "+1.0 (+1.0 to +1.0)"]
    assert len(training_lines(rows[rows.arm.str.contains("nothing")], shipped)) == 3


def test_pairs_that_a_scenario_lacks_leave_its_cell_empty():
    rows = rows_of(runs("a", 5) + runs("b", 4) + runs("c", 4, scenario="crowd") + runs("b", 2, scenario="crowd"))
    lines = [cells(line) for line in paired_lines(rows, [("a", "b"), ("c", "b")])]
    assert [line[0] for line in lines[2:]] == ["crowd", "pop_up"]
    assert lines[2][1] == ""
    assert lines[2][2].startswith("+20.0 (")
    assert lines[3][2] == ""
    assert lines[3][1].startswith("+10.0 (")


def test_what_a_run_takes_is_compared_on_seeds_that_both_survive_alone():
    slow = rows_of(runs("a", 2, episodes=2) + runs("b", 2, episodes=3))
    times = slow.assign(time_s=[9.0, 13.0, 8.0, 10.0, 700.0])  # b is hit in its third run, which took long
    cell = cells(cost_lines(times, [("a", "b")])[2])[1]
    assert cell == "+2.00 (-10.71 to +14.71)"  # 1 and 3: t of one degree 12.706, error of the mean 1
    assert len(cost_lines(times[times.seed == 0], [("a", "b")])) == 2  # one seed tells no interval


def test_what_the_bands_change_is_read_from_their_tables():
    rows = []
    for preference in (0.0, 0.5, 1.0):
        energy, clearance = 300 - 40 * preference, 0.4 - 0.1 * preference
        rows += runs("ppo", 10, preference=preference, energy_j=energy, min_clearance_m=clearance)
    line = cells(preference_lines(trade(rows_of(rows), draws=20))[2])
    assert line == ["pop_up", "300, 280, 260", "-40 (-40 to -40)", "0.40, 0.35, 0.30", "-0.10 (-0.10 to -0.10)"]
    numbers = {"scenario": "pop_up", "at_15": 0.4, "at_100": 0.45, "difference": -0.05, "low": -0.06, "high": -0.04}
    table = pd.DataFrame(
        [numbers | {"measure": "command |v| on the same states [m/s]"}, numbers | {"measure": "survived"}]
    )
    assert cells(band_lines(table)[2]) == ["pop_up", "0.450", "0.400", "-0.050 (-0.060 to -0.040)"]
    assert len(band_lines(table)) == 3


def test_objectives_without_a_single_goal_do_not_stop_the_page():
    rows = [row for p in (0.0, 0.5, 1.0) for row in runs("ppo", 0, preference=p)]
    table = trade(rows_of(rows), draws=5)
    assert np.isinf(table.at_a[table.measure == "energy_j_per_goal"]).all()
    assert "inf, inf, inf" in preference_lines(table)[2]
