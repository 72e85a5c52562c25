"""The town: exact ways against all ways by hand, times that matter, and an environment that counts what it charges."""

import itertools

import networkx as nx
import numpy as np
import pytest

from dualnav_lite.beyond.streets import (
    BLOCK_M,
    MOST_MOVES,
    RISK_PER_M,
    SLOTS,
    StreetsVectorEnv,
    Town,
    build_town,
    exact_walk,
    frozen_walk,
    risk_density,
    street_risk,
    walk_of,
    weigh,
)
from dualnav_lite.beyond.streets_dqn import PREFERENCES, front_table

TOWN = build_town(0)


def line_of(*places):
    """A town whose junctions are all joined in both directions, slot k leading to junction k."""
    places = np.array(places, float)
    n = len(places)
    neighbours = np.full((n, SLOTS), -1)
    for a, b in itertools.permutations(range(n), 2):
        neighbours[a, b] = b
    gaps = places[neighbours] - places[:, None]
    lengths = np.where(neighbours >= 0, np.hypot(gaps[..., 0], gaps[..., 1]), 0.0)
    return Town(
        places, neighbours, lengths, np.where(neighbours >= 0, np.maximum(np.rint(lengths / 80), 1), 0).astype(int)
    )


def test_streets_go_both_ways_and_everything_is_reached():
    for here, slot in zip(*np.nonzero(TOWN.neighbours >= 0), strict=True):
        there = TOWN.neighbours[here, slot]
        assert here in TOWN.neighbours[there]
    pairs = [(a, b) for a, row in enumerate(TOWN.neighbours) for b in row if b >= 0]
    assert nx.is_connected(nx.Graph(pairs))


@pytest.mark.parametrize("preference", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("minute", [700, 1150, 1430])
def test_the_exact_way_beats_every_other_way(preference, minute):
    town = line_of([100, 500], [250, 420], [420, 480], [300, 600], [560, 250])
    best = exact_walk(town, 0, 4, minute, preference)
    worth = weigh(best.metres, best.risk, preference)
    others = [
        walk_of(town, (0, *between, 4), minute)
        for length in range(4)
        for between in itertools.permutations((1, 2, 3), length)
    ]
    assert worth == pytest.approx(min(weigh(walk.metres, walk.risk, preference) for walk in others))


def test_for_metres_alone_the_exact_way_is_the_static_shortest_path():
    graph = nx.Graph()
    for here, slot in zip(*np.nonzero(TOWN.neighbours >= 0), strict=True):
        graph.add_edge(int(here), int(TOWN.neighbours[here, slot]), weight=float(TOWN.lengths[here, slot]))
    for start, goal in ((0, 48), (6, 42), (24, 3)):
        static = nx.dijkstra_path_length(graph, start, goal)
        assert exact_walk(TOWN, start, goal, 600, 1.0).metres == pytest.approx(static)


def test_thrift_never_walks_farther_and_caution_never_risks_more():
    for minute in (780, 20):
        walks = [exact_walk(TOWN, 0, 48, minute, p) for p in (0.0, 0.3, 0.6, 1.0)]
        assert all(b.metres <= a.metres + 1e-9 for a, b in itertools.pairwise(walks))
        assert all(b.risk >= a.risk - 1e-9 for a, b in itertools.pairwise(walks))


def test_the_safe_way_depends_on_the_hour():
    ways = {exact_walk(TOWN, 0, 48, minute, 0.0).junctions for minute in range(0, 1440, 120)}
    assert len(ways) >= 2


def test_a_way_planned_for_the_risk_at_departure_is_never_better_than_the_exact_one():
    for minute in (600, 1080, 1340):
        best, frozen = exact_walk(TOWN, 0, 48, minute, 0.2), frozen_walk(TOWN, 0, 48, minute, 0.2)
        worth = [weigh(walk.metres, walk.risk, 0.2) for walk in (best, frozen)]
        assert worth[0] <= worth[1] + 1e-9
    assert exact_walk(TOWN, 0, 48, 600, 1.0).metres == pytest.approx(frozen_walk(TOWN, 0, 48, 600, 1.0).metres)


def test_risk_peaks_at_its_hours_and_the_day_closes():
    bar = np.array([3.2, 3.2]) * BLOCK_M
    assert risk_density(bar, 30) > 5 * risk_density(bar, 12 * 60)
    assert risk_density(bar, 1440.0) == pytest.approx(risk_density(bar, 0.0))
    assert street_risk(TOWN, 30).min() >= 0.0


def test_an_episode_charges_what_the_walk_costs():
    env = StreetsVectorEnv(1, TOWN)
    trip = (0, 48, 1150, 0.3)
    way = exact_walk(TOWN, *trip[:3], trip[3])
    env.reset(options={"trips": [trip]})
    total, infos = 0.0, {}
    for here, there in itertools.pairwise(way.junctions):
        assert env.here[0] == here
        _, reward, terminated, _, infos = env.step([int(np.flatnonzero(TOWN.neighbours[here] == there)[0])])
        total += reward[0]
    assert terminated[0]
    assert infos["walks"][0] == (*trip, pytest.approx(way.metres), pytest.approx(way.risk), True)
    straight = np.hypot(*(TOWN.places[0] - TOWN.places[48]))
    assert total == pytest.approx((straight - weigh(way.metres, way.risk, 0.3)) / 100.0)


def test_a_walker_who_runs_into_houses_is_cut_off_and_charged():
    env = StreetsVectorEnv(1, TOWN, goals=[48])
    env.reset(options={"trips": [(0, 48, 0, 1.0)]})
    wall = int(np.flatnonzero(TOWN.neighbours[0] < 0)[0])
    for _ in range(MOST_MOVES):
        _, _, terminated, truncated, infos = env.step([wall])
    assert truncated[0]
    assert not terminated[0]
    assert infos["walks"][0][4:] == (pytest.approx(50.0 * MOST_MOVES), 0.0, False)


def test_preference_one_half_weighs_an_incident_like_its_metres():
    assert weigh(RISK_PER_M, 0.0, 0.5) == pytest.approx(weigh(0.0, 1.0, 0.5))


def test_the_table_knows_that_the_exact_way_costs_least():
    table = front_table(walks=4, seeds=(0,), steps=320)
    exact = table[table.arm == "exact"]
    assert exact.mean_excess.abs().max() < 1e-12
    assert (table.mean_excess.dropna() >= -1e-9).all()
    assert table[table.arm == "dqn"].training_seed.tolist() == [0] * len(PREFERENCES)
