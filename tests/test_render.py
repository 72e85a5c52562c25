"""Pictures show the world as it is, and looking changes nothing."""

from itertools import combinations

import cv2
import numpy as np
import pytest

from dualnav_lite import canvas, render
from dualnav_lite.canvas import BLUE, GREEN, ORANGE, Canvas, colour_map
from dualnav_lite.config import Config, Motion, Observation, UnusableInput
from dualnav_lite.env import DynamicNavEnv
from dualnav_lite.floorplan import WALL_M
from dualnav_lite.scenario import all_scenarios
from dualnav_lite.vector_env import DynamicNavVectorEnv

SEED = 1_000_000
PIXELS_PER_M = 60.0
# Red, green and blue (linear light) as eyes without the green-sensitive cones take them: Machado, Oliveira and
# Fernandes, "A physiologically-based model for simulation of color vision deficiency", 2009, severity 1.0.
WITHOUT_GREEN_CONES = np.array(
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
)


@pytest.fixture(scope="module")
def worlds():
    env = DynamicNavVectorEnv(2, Config(), "navigation", autoreset=False, render_mode="rgb_array")
    env.reset(seed=SEED)
    for _ in range(15):
        env.step(np.array([[0.5, 0.4], [0.4, -0.3]]))
    return env


def lab(rgb):
    """CIELAB of uint8 RGB colours, any leading shape."""
    flat = np.asarray(rgb, np.float32).reshape(1, -1, 3) / 255.0
    return cv2.cvtColor(flat, cv2.COLOR_RGB2LAB).reshape(*np.shape(rgb))


def middle_of(picture, colour, room):
    """Where in the room the pixels of one colour have their middle, (2,) [m]."""
    rows, columns = np.nonzero((picture == colour).all(axis=2))
    assert len(rows) > 10
    x = (columns.mean() + 0.5) / picture.shape[1] * (room.width + 2 * WALL_M) - WALL_M
    y = room.height + WALL_M - (rows.mean() + 0.5) / picture.shape[0] * (room.height + 2 * WALL_M)
    return np.array([x, y])


@pytest.mark.parametrize("scenario", ["crowd_crossing", "low_light_phantoms", "comms_dropout"])
def test_looking_at_a_world_or_not_gives_the_same_bytes(scenario):
    watched = DynamicNavVectorEnv(1, Config(), scenario, render_mode="rgb_array")
    unwatched = DynamicNavVectorEnv(1, Config(), scenario)
    first, other = watched.reset(seed=SEED)[0], unwatched.reset(seed=SEED)[0]
    assert first.tobytes() == other.tobytes()
    for _ in range(12):
        watched.render()
        seen = watched.step(np.array([[0.6, 0.2]]))
        missed = unwatched.step(np.array([[0.6, 0.2]]))
        assert seen[0].tobytes() == missed[0].tobytes()
        assert seen[1].tobytes() == missed[1].tobytes()
        for key in ("scan", "pose", "battery", "path_robot", "map", "vector_reward"):
            assert seen[4][key].tobytes() == missed[4][key].tobytes()


def test_the_same_world_gives_the_same_picture_and_another_moment_another_one():
    env = DynamicNavEnv(scenario="navigation", render_mode="rgb_array")
    env.reset(seed=SEED)
    first = env.render()
    assert first.dtype == np.uint8
    assert first.shape == (640, 960, 3)
    assert np.array_equal(first, env.render())
    env.step([0.5, 0.5])
    assert not np.array_equal(first, env.render())


@pytest.mark.parametrize("world", [0, 1])
def test_robot_and_goal_are_drawn_where_they_are(worlds, world):
    picture = render.draw_room(worlds, world, pixels_per_m=PIXELS_PER_M)
    sim = worlds.sim
    room = sim.layouts[world].room
    assert picture.shape[0] / (room.height + 2 * WALL_M) == pytest.approx(PIXELS_PER_M, abs=0.1)
    robot = middle_of(picture, BLUE, room)
    assert np.hypot(*(robot - sim.poses[world, :2])) < 0.06  # the white nose takes some blue away on one side
    behind = robot - sim.poses[world, :2]
    assert behind @ [np.cos(sim.poses[world, 2]), np.sin(sim.poses[world, 2])] < 0.03
    goal = middle_of(picture, canvas.mixed(GREEN, canvas.theme_of("light").floor, 0.75), room)
    assert np.hypot(*(goal - sim.goals[world])) < 0.06


def test_a_person_is_as_large_in_the_picture_as_in_the_world():
    env = DynamicNavVectorEnv(1, Config(), "crowd_crossing", render_mode="rgb_array")
    env.reset(seed=SEED)
    picture = render.draw_room(env, 0, pixels_per_m=PIXELS_PER_M)
    height = picture.shape[0] / PIXELS_PER_M
    margin = (height - env.sim.layouts[0].room.height) / 2
    orange = (picture == ORANGE).all(axis=2)
    for x, y, radius in env.sim.scene.circles[0, : env.sim.scene.num_circles[0]]:
        column, row = (x + margin) * PIXELS_PER_M, (height - margin - y) * PIXELS_PER_M
        reach = radius * PIXELS_PER_M
        window = orange[int(row - reach) : int(row + reach) + 1, int(column - reach) : int(column + reach) + 1]
        rows, columns = np.nonzero(window)
        outline = 0.12 * 2 * radius  # the dark ring and lidar dots lie on the edge
        for extent in (np.ptp(rows) + 1, np.ptp(columns) + 1):
            assert 2 * radius - outline - 0.1 <= extent / PIXELS_PER_M <= 2 * radius + 0.02


def test_channels_are_drawn_upright_and_cell_by_cell(worlds):
    observation = worlds.observations[0]
    picture = render.draw(worlds, 0, height=2 * render.HEIGHT)  # more than five pixels a cell
    left, top, side = render.PANEL_BOX
    for name, column, row in (("static", 0, 0), ("motion", 1, 0), ("intensity", 0, 1)):
        values = observation[render.CHANNELS.index(name)]
        wanted = render.coloured_channel(name, values).astype(int)
        places = (np.arange(64) + 0.5) / 64 * side
        rows = np.floor(2 * (top + row * render.PANEL_STEP[1] + 20 + places)).astype(int)
        columns = np.floor(2 * (left + column * render.PANEL_STEP[0] + places)).astype(int)
        found = picture[np.ix_(rows, columns)].astype(int)
        hidden = np.abs(np.arange(64) - 31.5) < 4  # by the robot's mark
        same = np.abs(found - wanted).max(axis=2) <= 2
        assert same[~hidden].mean() > 0.99
        assert same[:, ~hidden].mean() > 0.99


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("name", ["static", "signed", "intensity"])
def test_equal_steps_of_a_value_look_equally_large(theme, name):
    table = lab(colour_map(name, theme))
    for arm in (table[:128], table[128:]) if name == "signed" else (table,):
        steps = np.linalg.norm(arm[8::8] - arm[:-8:8], axis=1)
        assert steps.max() < 1.7 * steps.min()  # but for colours that a screen cannot show
        lightness = np.diff(arm[::8, 0])
        assert (lightness > 0).all() or (lightness < 0).all()


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_zero_is_the_quietest_colour_of_a_signed_channel(theme):
    below, zero, above = lab(canvas.coloured(np.array([-1.0, 0.0, 1.0]), "signed", theme))
    assert np.hypot(*zero[1:]) < 5
    assert np.linalg.norm(below - zero) > 50
    assert np.linalg.norm(above - zero) > 50


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_signs_differ_for_eyes_without_green_cones(theme):
    ends = canvas.coloured(np.array([-0.6, 0.6]), "signed", theme) / 255.0
    linear = np.where(ends <= 0.04045, ends / 12.92, ((ends + 0.055) / 1.055) ** 2.4)
    seen = np.clip(linear @ WITHOUT_GREEN_CONES.T, 0.0, 1.0)
    seen = np.where(seen <= 0.0031308, 12.92 * seen, 1.055 * seen ** (1 / 2.4) - 0.055)
    assert np.linalg.norm(np.diff(lab(255.0 * seen), axis=0)) > 30


@pytest.mark.parametrize("scenario", sorted(all_scenarios()))
def test_no_text_lies_over_another_or_leaves_the_page(scenario, monkeypatch):
    env = DynamicNavVectorEnv(1, Config(), scenario, render_mode="rgb_array")
    env.reset(seed=SEED)
    env.sim.times_s[:], env.journal.energy_j[:], env.sim.robots.battery[:] = 10799.0, 123456.0, 1.0
    env.sim.robots.twist[:] = -0.8, -1.2
    boxes = []
    write = Canvas.text

    def note(self, x, y, text, size, colour, weight=400, align=0.0):
        width = self.text_width(text, size, weight)
        boxes.append((x - align * width, y - 0.75 * size, x + (1 - align) * width, y + 0.22 * size, text))
        write(self, x, y, text, size, colour, weight, align)

    monkeypatch.setattr(Canvas, "text", note)
    render.draw(env, 0)
    assert len(boxes) > 30
    for x0, y0, x1, y1, text in boxes:
        assert x0 >= 0, text
        assert x1 <= render.WIDTH, text
        assert y0 >= 0, text
        assert y1 <= render.HEIGHT, text
    for a, b in combinations(boxes, 2):
        assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1], f"'{a[4]}' over '{b[4]}'"


def test_three_channels_dark_theme_and_small_pictures_work():
    config = Config(observation=Observation(intensity=False, motion=Motion(method="none")))
    env = DynamicNavVectorEnv(1, config, "pop_up", render_mode="rgb_array")
    env.reset(seed=SEED)
    light, dark = render.draw(env, 0, height=320), render.draw(env, 0, "dark", height=320)
    assert light.shape == dark.shape == (320, 480, 3)
    assert light.mean() > 200
    assert dark.mean() < 60
    with pytest.raises(ValueError, match="unknown theme 'pink'; known: light, dark"):
        render.draw(env, 0, "pink")


def test_a_robot_without_an_open_goal_is_drawn_without_one():
    env = DynamicNavVectorEnv(1, Config(), "battery", render_mode="rgb_array")
    env.reset(seed=SEED)
    with_goal = render.draw_room(env, 0)
    env.task.idle[0] = True  # as after a contact
    without = render.draw_room(env, 0)
    assert (with_goal == GREEN).all(axis=2).sum() > 100
    assert not (without == GREEN).all(axis=2).any()


def test_an_environment_draws_in_the_theme_that_was_asked_for():
    pictures = {}
    for theme in ("light", "dark"):
        env = DynamicNavEnv(scenario="navigation", render_mode="rgb_array", render_theme=theme)
        env.reset(seed=SEED)
        pictures[theme] = env.render()
    assert pictures["dark"].mean() < 60 < 180 < pictures["light"].mean()
    with pytest.raises(UnusableInput, match="render_theme 'pink' is unknown; known: light, dark"):
        DynamicNavEnv(render_mode="rgb_array", render_theme="pink")
