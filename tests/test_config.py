"""Configuration: frozen, complete, and wrong input refused in one clear line."""

import os

import pytest

from dualnav_lite.config import (
    Config,
    Frozen,
    UnusableInput,
    dump_config,
    load_config,
    read_yaml,
    validated,
    with_overrides,
    write_atomic,
)


def test_defaults_survive_a_round_trip_through_yaml(tmp_path):
    path = tmp_path / "配置 with space" / "config.yaml"
    assert load_config(path) == Config()
    assert load_config(path) == Config()
    assert path.read_text(encoding="utf-8") == dump_config(Config())


def test_the_article_s_keys_are_where_the_article_has_them():
    config = validated(
        Config, {"simulator": "pymunk", "hardware": {"max_lin_vel": 0.8, "max_ang_vel": 1.2}, "test_mode": True}, "x"
    )
    assert config.test_mode
    assert config.hardware.max_ang_vel == 1.2


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"hardwear": {}}, ["unknown key 'hardwear'", "hardware"]),
        ({"hardware": {"max_vel": 1}}, ["unknown key 'hardware.max_vel'", "max_lin_vel"]),
        ({"observation": {"motion": {"methode": "x"}}}, ["observation.motion.methode", "component", "method"]),
        ({"hardware": {"max_lin_vel": "fast"}}, ["hardware.max_lin_vel", "'fast'"]),
        ({"hardware": {"max_lin_vel": -1}}, ["hardware.max_lin_vel", "greater than 0"]),
        ({"lidar": {"range_max_m": float("nan")}}, ["lidar.range_max_m"]),
        ({"simulator": "gazebo"}, ["simulator", "pymunk"]),
        ({"preference": 1.5}, ["preference"]),
        ({"physics_dt_s": 0.03}, ["whole multiple"]),
        ({"control_dt_s": 0.05}, ["control_dt_s", "only 0.1 is possible", "got 0.05"]),
        ({"map": {"resolution_m": 0.05}}, ["map.resolution_m", "only 0.1 is possible", "got 0.05"]),
        (
            {"power": {"idle_w": 0, "linear_w_s_m": 0, "quadratic_w_s2_m2": 0}},
            ["power: ", "one of idle_w, linear_w_s_m and quadratic_w_s2_m2 must be above 0"],
        ),
        ({"lidar": {"range_min_m": 10, "range_max_m": 5}}, ["lidar", "range_max_m (5)", "range_min_m (10)"]),
        ({"hardware": {"max_lin_vel": True}}, ["hardware.max_lin_vel", "a number is wanted"]),
        ({"preference": True}, ["preference", "a number is wanted"]),
        ([1, 2], ["top level"]),
    ],
)
def test_wrong_configs_are_refused_in_one_line_with_the_key(values, words):
    with pytest.raises(UnusableInput) as caught:
        validated(Config, values, "config.yaml")
    text = str(caught.value)
    assert "\n" not in text
    for word in ["config.yaml", *words]:
        assert word in text


def test_unreadable_yaml_names_file_and_line(tmp_path):
    path = tmp_path / "broken.yaml"
    path.write_text("hardware:\n  max_lin_vel: [0.8\n", encoding="utf-8")
    with pytest.raises(UnusableInput, match=r"broken\.yaml: not valid YAML in line"):
        load_config(path)
    path.write_bytes(b"\xff\xfe\x00bad")
    with pytest.raises(UnusableInput, match="UTF-8"):
        load_config(path)
    with pytest.raises(UnusableInput, match="cannot be read"):
        load_config(tmp_path)


@pytest.mark.parametrize("text", ["a: 2026-13-45", "a: \x01", "[" * 3000, "a: *b", "a: 1\n---\nb: 2"])
def test_whatever_yaml_cannot_hold_is_one_line(tmp_path, text):
    path = tmp_path / "odd.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UnusableInput, match=r"odd\.yaml: not valid YAML") as caught:
        load_config(path)
    assert "\n" not in str(caught.value)


def test_a_key_that_stands_twice_is_refused_with_both_lines(tmp_path):
    path = tmp_path / "twice.yaml"
    path.write_text("map:\n  cache: true\nhardware:\n  max_lin_vel: 0.5\n  max_lin_vel: 0.8\n", encoding="utf-8")
    with pytest.raises(UnusableInput, match=r"twice\.yaml: .*in line 5: key 'max_lin_vel' stands there twice.* line 4"):
        load_config(path)
    path.write_text("a: &a {x: 1}\nb: {<<: *a, x: 2}\n", encoding="utf-8")
    assert read_yaml(path)["b"] == {"x": 2}  # a merged key may be overruled


def test_booleans_in_lists_are_no_numbers_either():
    class Seeds(Frozen):
        seeds: list[int]
        is_fast: bool

    assert validated(Seeds, {"seeds": [1], "is_fast": True}, "x").is_fast
    with pytest.raises(UnusableInput, match=r"x: seeds\.1: a number is wanted"):
        validated(Seeds, {"seeds": [1, True], "is_fast": True}, "x")


def test_a_config_cannot_change_after_it_was_read():
    with pytest.raises(ValueError, match="frozen"):
        Config().hardware.max_lin_vel = 2.0


def test_overrides_name_the_known_keys():
    assert with_overrides(Config(), {"map.cache": False}).map.cache is False
    with pytest.raises(UnusableInput, match=r"map\.cach.*cache"):
        with_overrides(Config(), {"map.cach": False})


def test_a_file_that_cannot_be_written_leaves_nothing_behind(tmp_path):
    blocker = tmp_path / "file"
    blocker.write_text("x", encoding="utf-8")
    with pytest.raises(UnusableInput, match="cannot be written"):
        write_atomic(blocker / "inside.yaml", "text")
    target = tmp_path / "folder"
    target.mkdir()
    with pytest.raises(UnusableInput, match="cannot be written"):
        write_atomic(target, "text")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder"]


@pytest.mark.skipif(os.name == "nt", reason="Windows has no mode bits for others")
def test_a_written_file_can_be_read_by_whom_the_umask_lets(tmp_path):
    ordinary = tmp_path / "ordinary"
    ordinary.touch()
    write_atomic(tmp_path / "written", "text")
    assert (tmp_path / "written").stat().st_mode == ordinary.stat().st_mode
