"""Driving by hand and sliders: the same episode as `drive`, buttons that drive, a line where there are no widgets."""

import sys

import numpy as np
import pytest

from dualnav_lite.figures.lesson import drive
from dualnav_lite.figures.play import NO_WIDGETS, HandDriver, slider_box, sliders

COMMANDS = [(0.0, -1.0, 0.5), (0.6, 0.2, 1.5)]


def test_a_robot_driven_by_hand_costs_what_the_same_commands_cost_elsewhere():
    hand = HandDriver(seed=207)
    for command in COMMANDS:
        hand.go(*command)
    actions = iter([(v, omega) for v, omega, seconds in COMMANDS for _ in range(round(10 * seconds))])
    table = drive(lambda observation, info: next(actions), seed=207, steps=20)["table"]
    np.testing.assert_allclose(hand.point, [table.clearance_m.min(), table.energy_j.iloc[-1]])
    assert hand.words().startswith("not there yet after 2.0 s")


def test_an_episode_that_ended_stays_as_it_is_and_can_begin_again():
    hand = HandDriver(seed=207).go(0.0, -1.0, 3.0).go(0.6, 0.0, 14.0)
    assert hand.outcome == "hit_person"
    before = hand.words()
    assert hand.go(0.5, 0.0, 1.0).words() == before
    hand.again()
    assert hand.point == (np.inf, 0.0)


def test_buttons_drive_and_the_picture_moves():
    controls = HandDriver(seed=207, pace_s=0.0).controls()
    (v, omega), buttons, line, image = controls.children[0].children, *controls.children[1:]
    first, shown = bytes(image.value), []
    image.observe(lambda change: shown.append(bytes(change["new"])), "value")
    v.value, omega.value = 0.4, 0.3
    buttons.children[0].click()
    assert line.value.startswith("not there yet after 0.5 s")
    assert first.startswith(b"\x89PNG")
    assert len(set(shown)) >= 3  # a film, not a jump
    buttons.children[-1].click()
    assert bytes(image.value) == first


def test_a_slider_that_is_let_go_draws_again():
    drawn = []
    box = slider_box(lambda preference: drawn.append(preference), preference=(0.0, 1.0, 0.1, 0.5))
    box.children[0].value = 0.8
    assert drawn == [0.8]
    assert not box.children[0].continuous_update


def test_without_widgets_a_line_says_what_to_do(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "ipywidgets", None)
    HandDriver(seed=207).panel()
    sliders(lambda p: pytest.fail("nobody asked"), p=(0.0, 1.0, 0.1, 0.5))
    assert capsys.readouterr().out == f"{NO_WIDGETS}\n{NO_WIDGETS}\n"
