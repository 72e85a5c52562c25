"""The benchmark measures what it says: times, verdicts, and peers that see the same room as our lidar."""

import csv
import time

import numpy as np
import pytest

from dualnav_lite import bench
from dualnav_lite.bench import peers
from dualnav_lite.config import Config
from dualnav_lite.geometry import beam_directions
from dualnav_lite.layout import generate
from dualnav_lite.lidar import Lidar
from dualnav_lite.scenario import Scenario
from dualnav_lite.simulation import Simulation

ROOM = Scenario.model_validate(bench.BENCH_ROOM)


def test_the_room_holds_furniture_a_wall_with_a_door_and_six_people():
    layout = generate(ROOM, Config(), bench.SEED)
    assert len(peers.people(layout)) == len(layout.movers) == 6
    assert len(layout.room.boxes) == 4 + 8


@pytest.mark.parametrize(("package", "peer"), [("ir-sim", peers.IrSim), ("navground", peers.Navground)])
def test_a_peer_sees_the_room_that_our_lidar_sees(package, peer):
    if peers.version(package) is None:
        pytest.skip(f"{package} is not installed (requirements-bench.txt)")
    config = Config()
    sim = Simulation(1, config)
    layout = sim.reset(0, ROOM, bench.SEED)
    ours = Lidar(config.lidar, 1).cast(sim.poses, sim.scene)[0][0]
    cosines, sines = beam_directions(config.lidar.beams)
    # Peers' beams run from -pi to pi with both ends, so ours are read in between; edges of things differ there.
    theirs = peer(layout, config).scan()
    ours = np.interp(np.linspace(-np.pi, np.pi, len(theirs)), np.arctan2(sines, cosines), ours)
    assert np.mean(np.abs(theirs - ours) < 0.02) > 0.97


def test_the_median_time_of_a_call_is_its_time():
    # A busy machine may sleep longer, never shorter.
    assert 0.01 <= bench.seconds_per_call(lambda: time.sleep(0.01), 0.1) < 0.2
    assert 0.002 <= bench.seconds_per_call(lambda: time.sleep(0.002), 0.05, block=5) < 0.1


@pytest.mark.parametrize(
    ("value", "smaller", "verdict"),
    [(99, False, "below"), (100, False, "reaches target"), (500, False, "reaches aim"), (None, False, "")],
)
def test_a_rate_is_judged_by_target_and_aim(value, smaller, verdict):
    assert bench.Row("x", value, "/s", 100, 500, smaller_is_better=smaller).verdict == verdict


@pytest.mark.parametrize(("value", "verdict"), [(61, "below"), (60, "reaches target"), (15, "reaches aim")])
def test_a_duration_is_judged_the_other_way_round(value, verdict):
    assert bench.Row("x", value, "s", 60, 15, smaller_is_better=True).verdict == verdict


def test_peers_that_are_missing_are_said_to_be(monkeypatch):
    monkeypatch.setattr(peers, "version", lambda package: None)
    rows = bench.peer_rows(ROOM, Config(), 0.01, {bench.STEP: 1000.0, bench.SCAN: 50_000.0})
    assert len(rows) == 6
    assert all(row.value is None for row in rows)
    assert all("not installed" in bench.row_line(row) for row in rows)
    assert all("not installed" in row.peer for row in rows)


def test_how_many_times_faster_is_our_rate_over_theirs(monkeypatch):
    monkeypatch.setattr(peers, "version", lambda package: "1.0")
    monkeypatch.setattr(bench, "ir_sim_seconds", lambda *_: {bench.STEP: 0.01, bench.SCAN: 0.005})
    monkeypatch.setattr(bench, "navground_seconds", lambda *_: {bench.SCAN: 0.0001})
    rows = bench.peer_rows(ROOM, Config(), 0.01, {bench.STEP: 2000.0, bench.SCAN: 50_000.0})
    assert [(row.value, row.unit) for row in rows] == [
        (pytest.approx(value), unit)
        for value, unit in [(100, "/s"), (20, "x"), (200, "/s"), (250, "x"), (10_000, "/s"), (5, "x")]
    ]
    assert rows[1].verdict == "reaches target"


def test_the_csv_holds_every_row(tmp_path):
    rows = [*bench.lidar_rows(ROOM, Config(), 0.02), bench.Row("missing", None, "x", 15, 100, "ir-sim not installed")]
    table = list(csv.DictReader(bench.rows_csv(rows).splitlines()))
    assert [line["what"] for line in table] == [row.what for row in rows]
    assert float(table[0]["value"]) > 1000
    assert table[-1]["value"] == ""
    assert table[-1]["peer"] == "ir-sim not installed"
