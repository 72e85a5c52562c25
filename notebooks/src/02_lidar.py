# %% [markdown]
# # 02 Lidar: rays, brightness, and what darkness does
#
# **Aim**: cast a laser turn by hand, and spoil it the way low light does.
#
# **Time**: 30 minutes for you, 6 s of CPU. **Number to expect**: your ranges and the library's differ by less
# than **1e-9 m**; at 5 lux **15 %** of the beams come back with nothing.
#
# A lidar turns a beam of light and measures how long it takes to come back. So a scan is 1080 answers to one question:
# *in this direction, how far is the first thing?*

# %% tags=["parameters"]
quick = False  # the tests run this notebook with fewer pictures

# %% tags=["given"]
import numpy as np

from dualnav_lite.check import check

RANGE_MIN, RANGE_MAX = 0.05, 10.0  # [m]
BRIGHT_LUX = 300.0  # an office
BEARINGS = -np.pi + 2 * np.pi * np.arange(1080) / 1080  # [rad], 0 ahead, counter-clockwise

# %%
import matplotlib.pyplot as plt
import pandas as pd
from IPython.display import display

from dualnav_lite.env import DynamicNavEnv
from dualnav_lite.figures.lesson import BLUE, GREEN, GREY, ORANGE, RED, film, lesson_style, photo
from dualnav_lite.kernels.scan_noise import path_loss
from dualnav_lite.lidar import Lidar
from dualnav_lite.semantics import REFLECTIVITY, Surface

lesson_style()


# %% [markdown]
# ## 1. A ray against a wall
#
# The beam is $p + t\,d$ with $t > 0$, from the robot $p$ in the direction $d = (\cos, \sin)$ of heading + bearing. The
# wall is $a + u\,e$ with $0 \le u \le 1$, from its one end $a$ along $e$ to the other. They meet where
#
# $$p + t\,d = a + u\,e$$
#
# Two equations, two unknowns: Cramer's rule. With the cross product $x \times y = x_1 y_2 - x_2 y_1$,
#
# $$t = \frac{(a - p) \times e}{d \times e} \qquad u = \frac{(a - p) \times d}{d \times e}$$
#
# and $d \times e = 0$ where they are parallel. Of all walls, the smallest $t$ counts.
#
# **Exercise `cast_scan`** (medium, very important, 15 minutes). `segments` has a row x0, y0, x1, y1 a wall. A beam that
# meets nothing within `range_max` reads `range_max`. Walls have no front or back here.

# %% grade_id="cast_scan" tags=["solution"]
def cast_scan(pose, bearings, segments, range_max):
    """(beams,) ranges [m] from a pose x, y, heading, along bearings [rad] relative to the heading."""
    ### BEGIN SOLUTION
    ranges = np.full(len(bearings), float(range_max))
    dx, dy = np.cos(pose[2] + bearings), np.sin(pose[2] + bearings)
    for x0, y0, x1, y1 in segments:
        ax, ay, ex, ey = x0 - pose[0], y0 - pose[1], x1 - x0, y1 - y0
        determinant = dx * ey - dy * ex
        crosses = determinant != 0
        safe = np.where(crosses, determinant, 1.0)
        t, u = (ax * ey - ay * ex) / safe, (ax * dy - ay * dx) / safe
        is_met = crosses & (t > 0) & (u >= 0) & (u <= 1) & (t < ranges)
        ranges[is_met] = t[is_met]
    return ranges
    ### END SOLUTION


# %% grade_id="cast_scan_check" points=4 tags=["check"]
check("cast_scan", cast_scan)

# %% [markdown]
# Your rays in a room of the simulator, beside the library's kernel:

# %%
env = DynamicNavEnv(scenario="low_light")
env.reset(seed=8)
sim = env.worlds.sim
pose, scene = sim.poses[0].copy(), sim.scene
walls = scene.segments[0, : scene.num_segments[0]]
scene.num_circles[0] = 0  # people are circles: a quadratic equation, left to the library
mine = cast_scan(pose, BEARINGS, walls, RANGE_MAX)
clean, surfaces, incidence = (values[0].copy() for values in Lidar(env.config.lidar, 1).cast(sim.poses, scene))

figure, axis = plt.subplots(figsize=(5, 5))
for k in range(0, 1080, 12):
    angle = pose[2] + BEARINGS[k]
    tip = pose[:2] + mine[k] * np.array([np.cos(angle), np.sin(angle)])
    axis.plot([pose[0], tip[0]], [pose[1], tip[1]], color=ORANGE, linewidth=0.6)
axis.plot(walls[:, [0, 2]].T, walls[:, [1, 3]].T, color=GREY)
axis.plot(*pose[:2], "o", color=BLUE, markersize=9)
axis.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="every twelfth of your beams")
axis.grid(False)
plt.show()
print("within 1e-9 m of the library:", bool(np.abs(mine - clean).max() < 1e-9))
# expect: within 1e-9 m of the library: True

# %% [markdown]
# The library does the same with numba, by another formula (`kernels/lidar.py`). Two ways to one number: that is how
# it is tested.
#
# ## 2. Intensity: how much light came back
#
# $$I = \rho \cdot (0.3 + 0.7 \cos\alpha) \cdot \frac{1}{1 + 4\left(\max(0, r - 1) / 9\right)^2}$$
#
# A white wall reflects more ($\rho$ = 0.70) than trousers (0.35); a wall seen at a slant ($\alpha$) throws light
# elsewhere; and far things are faint. The range alone cannot tell a person from a pillar; the brightness gives a hint.

# %%
distance = np.linspace(0.1, 10.0, 100)  # [m]
loss = np.array([path_loss(one) for one in distance])
SHOWN = {Surface.WALL: BLUE, Surface.FURNITURE: GREEN, Surface.PERSON: ORANGE, Surface.PHANTOM: RED}
figure, axis = plt.subplots(figsize=(8, 2.8))
for surface, colour in SHOWN.items():
    head_on, slanted = REFLECTIVITY[surface] / loss, 0.42 * REFLECTIVITY[surface] / loss
    axis.fill_between(distance, slanted, head_on, color=colour, alpha=0.35, label=surface.name.lower())
    axis.plot(distance, head_on, color=colour, linewidth=1)
axis.set(xlabel="range [m]", ylabel="intensity", title="from head-on (upper line) to 80 degrees aside", ylim=(0, 0.75))
axis.legend(ncols=4)
plt.show()


# %% [markdown]
# The bands overlap: a wall at a slant looks like a person. Intensity is evidence, not a label. (A *phantom* is a faint
# reflection that stands still for a second or two: a beam meets it, a hull does not. A variant of `low_light` has them.)
#
# ## 3. Low light
#
# A lidar brings its own light, so darkness does not blind it. The article says it does; here "low light" stands for a
# bad signal-to-noise ratio, and one formula turns lux into it. With the darkness $q = 1 - \log_{10}(\text{lux}) /
# \log_{10}(300)$, held in $[0, 1]$:
#
# | what | how much |
# |---|---|
# | range noise | $\sigma = 0.01 + 0.042\,q$ metres |
# | lost beams | a share of $0.005 + 0.20\,q$ |
# | intensity | times $1 - 0.557\,q$ |
#
# **Exercise `scan_noise`** (easy, important, 10 minutes). `normal` and `uniform` are a random number a beam, `ambient_lux` is
# one number. A reading is the range plus $\sigma$ times `normal`, held in [0.05, 10] m. A beam is lost where `uniform` is
# below the share, and then reads 10 m and intensity 0.

# %% grade_id="scan_noise" tags=["solution"]
def scan_noise(ranges, intensities, ambient_lux, normal, uniform):
    """(beams, 2) readings: range [m] and intensity, from clean ones (beams,) in a light [lux]."""
    ### BEGIN SOLUTION
    q = np.clip(1.0 - np.log10(ambient_lux) / np.log10(BRIGHT_LUX), 0.0, 1.0)
    is_lost = uniform < 0.005 + 0.20 * q
    readings = np.clip(ranges + (0.01 + 0.042 * q) * normal, RANGE_MIN, RANGE_MAX)
    light = (1.0 - 0.557 * q) * intensities
    return np.stack([np.where(is_lost, RANGE_MAX, readings), np.where(is_lost, 0.0, light)], axis=1)
    ### END SOLUTION


# %% grade_id="scan_noise_check" points=3 tags=["check"]
check("scan_noise", scan_noise)

# %%
loss = np.array([path_loss(one) for one in clean])
light = REFLECTIVITY[surfaces] * (0.3 + 0.7 * incidence) / loss
random = np.random.default_rng(2)


def turn(lux):
    """A scan of the room at a light."""
    return scan_noise(clean, light, lux, random.standard_normal(1080), random.random(1080))


def draw_turn(lux):
    """The points of one turn, brightness as colour."""
    scan = turn(lux)
    kept = scan[:, 1] > 0
    x, y = scan[kept, 0] * np.cos(BEARINGS[kept]), scan[kept, 0] * np.sin(BEARINGS[kept])
    figure, axis = plt.subplots(figsize=(5.6, 4.6))
    shown = axis.scatter(-y, x, c=scan[kept, 1], s=5, cmap="plasma", vmin=0, vmax=0.7)
    axis.plot(0, 0, marker="^", color=BLUE, markersize=9)
    axis.set(xlim=(-8, 8), ylim=(-6, 6), aspect="equal", xlabel="to the right [m]", ylabel="ahead [m]")
    axis.set_title(f"{lux:.0f} lux: {100 * np.mean(~kept):.0f} % of the beams lost")
    figure.colorbar(shown, ax=axis, label="intensity", shrink=0.8)
    return figure


LIGHTS = (300.0, 100.0, 30.0, 10.0, 5.0, 2.0, 1.0)  # [lux]
if quick:
    draw_turn(5.0)
    plt.show()
else:
    display(film([photo(draw_turn(lux)) for lux in LIGHTS for _ in range(3)], 300, 560))
many = np.concatenate([turn(5.0) for _ in range(200)])
back = many[:, 1] > 0
sigma = np.std((many[:, 0] - np.tile(clean, 200))[back & (many[:, 0] < RANGE_MAX)])
dimmed = np.median(many[back, 1] / np.tile(light, 200)[back])
print(f"at 5 lux: {100 * np.mean(~back):.0f} % lost, sigma {100 * sigma:.1f} cm, intensity x {dimmed:.2f}")
# expect: at 5 lux: 15 % lost, sigma 4.0 cm, intensity x 0.60

# %% [markdown]
# ## 4. Ghosts, and a filter of one line
#
# The library adds one thing more: bursts of three to eight neighbouring echoes from nothing, faint ones. A robot that
# believes them brakes for air. But a real thing that near would be bright. So ask how bright each echo would be from 1 m,
# and distrust what is fainter than any surface:
#
# $$I \cdot \left(1 + 4\left(\max(0, r - 1)/9\right)^2\right) < \text{WEAK}$$

# %%
WEAK = 0.06
lidar = Lidar(env.config.lidar, 1)
true_range = clean.copy()
counts = np.zeros(4)  # ghosts, ghosts caught, real echoes, real echoes thrown away
for step in range(200):
    scans, _ = lidar.scan(sim.poses, scene, np.array([5.0]), np.array([7], np.uint64), np.array([step]))
    scan = scans[0].astype(float)
    came_back = scan[:, 1] > 0
    is_ghost = came_back & (scan[:, 0] < true_range - 0.3)  # far more than the noise
    is_weak = came_back & (scan[:, 1] * np.array([path_loss(one) for one in scan[:, 0]]) < WEAK)
    is_real = came_back & ~is_ghost
    counts += [is_ghost.sum(), (is_ghost & is_weak).sum(), is_real.sum(), (is_real & is_weak).sum()]
ghosts, caught, real, thrown = counts
share = 100 * ghosts / (200 * 1080)
print(f"ghosts {share:.1f} %; caught {100 * caught / ghosts:.0f} %, real echoes lost {100 * thrown / real:.1f} %")
# expect: ghosts 0.6 %; caught 75 %, real echoes lost 0.1 %
pd.DataFrame(
    {"share of the echoes [%]": [100 * caught / ghosts, 100 * thrown / real]},
    index=["ghosts that the filter throws away", "real echoes that it throws away"],
).round(1)

# %% [markdown]
# Without the intensity channel no filter of this kind exists: a ghost's *range* is as good as any. That is what the
# fourth channel of the observation is for (lesson 06), and what the stress test `low_light` asks.
#
# ## Change this one line and look
#
# - `WEAK = 0.06`: 0.03 and 0.12. What do you gain, what do you lose? (Trousers that a beam just grazes are at 0.06.)
# - `seed=8` in part 1: another room, and your rays still agree.
# - In `scan_noise`, give lost beams the range 0 in place of 10. What would a robot do that brakes for near things?
#
# Papers: Thrun, Burgard, Fox, *Probabilistic Robotics*, 2005, section 6.3 (what is wrong with beams: noise, short
# readings, lost ones); Amanatides, Woo, *A fast voxel traversal algorithm for ray tracing*, 1987, for rays on grids.
