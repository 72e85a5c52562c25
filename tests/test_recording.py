"""Claims about recorded drives: whole, the same for any number of worlds, and laid out as the article says."""

import re

import cv2
import numpy as np
import pandas as pd
import pytest

from dualnav_lite.__main__ import main
from dualnav_lite.config import UnusableInput
from dualnav_lite.forecast import SHIPPED
from dualnav_lite.geometry import to_robot
from dualnav_lite.recording import LOG_COLUMNS, drive, load, names, record, save

SAMPLE = SHIPPED.parent.parent / "data" / "sample"
README = SAMPLE.parent / "README.md"


def test_a_drive_does_not_depend_on_its_neighbours():
    one = {r.seed: r for r in drive("navigation", "straight", [3, 4, 5], num_envs=1)}
    two = {r.seed: r for r in drive("navigation", "straight", [3, 4, 5], num_envs=2)}
    assert set(one) == set(two) == {3, 4, 5}
    for seed, recording in one.items():
        assert len(recording.scans) == recording.summary["steps"] + 1
        for name in ("scans", "poses", "true_poses", "movers", "map"):
            np.testing.assert_array_equal(getattr(recording, name), getattr(two[seed], name))


def test_what_is_recorded_as_there_is_what_the_scan_sees():
    recording = next(drive("crowd_crossing", "stand_still", [7], most_frames=12))
    assert len(recording.scans) == 12
    assert recording.summary == {}  # cut off
    people = to_robot(recording.movers[-1], recording.true_poses[-1])
    seen = 0
    for x, y in people[np.isfinite(people).all(axis=1)]:
        beam = round((np.arctan2(y, x) + np.pi) / (2 * np.pi) * 1080) % 1080
        seen += abs(recording.scans[-1, beam, 0] - np.hypot(x, y)) < 0.4
    assert seen >= 2


def test_a_recording_comes_back_as_it_was_saved(tmp_path):
    recording = next(drive("pop_up", "straight", [11], most_frames=15))
    save(recording, tmp_path)
    back = load(tmp_path, recording.name)
    assert names(tmp_path) == [recording.name]
    assert (back.scenario, back.arm, back.seed) == ("pop_up", "straight", 11)
    np.testing.assert_array_equal(back.scans, recording.scans)
    np.testing.assert_array_equal(back.poses, recording.poses)
    np.testing.assert_allclose(back.movers, recording.movers, atol=1e-6)
    np.testing.assert_allclose(back.map, recording.map, atol=0.003)
    scans = np.load(tmp_path / "scans" / f"{recording.name}.npy")
    assert scans.shape == (15, 1080, 2)
    assert cv2.imread(str(tmp_path / "maps" / f"{recording.name}.png"), cv2.IMREAD_GRAYSCALE).shape == (64, 64)


def test_the_log_holds_both_objectives(tmp_path):
    record(["navigation"], ["straight", "stand_still"], [3], tmp_path, progress=False)
    log = pd.read_csv(tmp_path / "logs" / "episodes.csv")
    assert list(log.arm) == ["stand_still", "straight"]
    assert (log.total_energy > 0).all()
    assert (log.avg_safe_dist > 0).all()
    assert len(names(tmp_path)) == 2


def test_windows_before_the_first_scan_repeat_it():
    recording = next(drive("navigation", "straight", [3], most_frames=15))
    scans, poses = recording.windows([2, 12])
    assert scans.shape == (2, 10, 1080, 2)
    np.testing.assert_array_equal(poses[0], recording.poses[[0] * 8 + [1, 2]])
    np.testing.assert_array_equal(scans[1], recording.scans[3:13])


def test_a_recording_that_is_not_there_is_one_clear_line(tmp_path):
    with pytest.raises(UnusableInput, match="no recording 'nothing'"):
        load(tmp_path, "nothing")
    with pytest.raises(UnusableInput, match="unknown arm"):
        next(drive("navigation", "nobody", [1]))


def test_the_committed_sample_is_small_and_whole():
    (name,) = names(SAMPLE)
    recording = load(SAMPLE, name)
    assert sum(path.stat().st_size for path in SAMPLE.rglob("*")) < 3 * 2**20
    assert len(recording.scans) == len(recording.poses) == len(recording.movers)
    log = pd.read_csv(SAMPLE / "logs" / "episodes.csv")
    assert log.episode[0] == name
    assert log.frames[0] == len(recording.scans)


def test_the_command_in_the_readme_records_the_committed_sample_again(tmp_path):
    command = re.search(r"^python kit\.py (record .+) --out data/sample$", README.read_text("utf-8"), re.MULTILINE)[1]
    assert main([*command.split(), "--out", str(tmp_path)]) == 0
    assert names(tmp_path) == names(SAMPLE)
    (name,) = names(SAMPLE)
    again, kept = (pd.read_csv(folder / "logs" / "episodes.csv") for folder in (tmp_path, SAMPLE))
    assert again.drop(columns=LOG_COLUMNS[-3:]).equals(kept.drop(columns=LOG_COLUMNS[-3:]))
    np.testing.assert_allclose(again[LOG_COLUMNS[-3:]], kept[LOG_COLUMNS[-3:]], rtol=0.02)  # another processor's digits
    one, two = load(tmp_path, name), load(SAMPLE, name)
    for part in ("scans", "poses", "true_poses", "movers"):
        np.testing.assert_allclose(getattr(one, part)[:20], getattr(two, part)[:20], atol=1e-3)
