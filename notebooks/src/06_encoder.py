# %% [markdown]
# # 06 Encoder: one image that says everything
#
# **Aim**: turn scans, a map and the robot's own numbers into the image `(4, 64, 64)` that a policy sees.
#
# **Time**: 45 minutes for you, 6 s of CPU. **Number to expect**: your image and the library's differ by **0.00**
# over a whole drive through a crowd.
#
# Everything is seen from the robot: it sits in the middle, looks up, and a cell is 0.1 m wide. So the image is the same
# wherever the robot stands in the room, and the policy need not learn each corner anew.

# %% tags=["parameters"]
quick = False  # the tests run this notebook with fewer pictures

# %% tags=["given"]
import numpy as np

from dualnav_lite.check import check
from dualnav_lite.config import Motion
from dualnav_lite.encoder import BAND_EDGES, BANDS, Ego
from dualnav_lite.motion import Prediction, motion_fields

SPEED_SCALE, TURN_SCALE = 0.8, 1.2  # [m/s], [rad/s] that read 1
GOAL_SCALE = 2.0  # [m], distance that reads 0.5
AGE_SCALE = 2.0  # [s] that read 1
SIZE, CELL_M = 64, 0.1


def motion_channel(scans, poses, ego):
    """Channel 1, as lessons 04 and 05 build it: where movers will be in the next 2 s. (64, 64) in [-1, 1]."""
    forecast, method = ego.forecast, "none"
    if forecast is not None:
        parts = (forecast.positions, forecast.velocities, forecast.valid, forecast.radii)
        forecast, method = Prediction(*(np.asarray(part)[None] for part in parts)), "forecast"
    return motion_fields(scans[None], poses[None], forecast, Motion(method=method))[0]


# %%
import matplotlib.pyplot as plt
from IPython.display import display

from dualnav_lite.encoder import encode_state as library_encoder
from dualnav_lite.figures.lesson import drive, film, lesson_style, photo, planned

lesson_style()


# %% [markdown]
# ## 1. Why an image, and why not the article's
#
# A flat list of 1080 ranges forgets who is whose neighbour, and says nothing of what moves. So the article paints three
# channels. But its third one is a single number, the battery, in every cell: speed and turning rate have vanished from
# its listing, and the *goal was never there*. A robot that cannot see its goal cannot go to it.

# %%
def articles_third_channel(battery, vel, ang_vel):
    """The article's 2.2, as printed."""
    return np.full((64, 64), battery)


parked, racing = articles_third_channel(0.8, 0.0, 0.0), articles_third_channel(0.8, 0.8, 1.2)
print(f"parked and racing differ by {np.abs(parked - racing).max():.1f}")
# expect: parked and racing differ by 0.0

# %% [markdown]
# ## 2. `paint_bands`: ten numbers, ten stripes
#
# The cure: cut the 64 rows into ten bands, and fill each with one number. The network reads them back exactly.
#
# | band | value |
# |---|---|
# | `v`, `omega` | $v / 0.8$, $\omega / 1.2$, clipped to $[-1, 1]$ |
# | `battery` | charge, in $[0, 1]$ |
# | `goal_distance` | $d / (d + 2)$ with $d$ in metres: fine near the goal, never saturated |
# | `goal_sin`, `goal_cos` | of the bearing to the goal: $y/d$ (left is positive) and $x/d$ |
# | `guide_sin`, `guide_cos` | the same for the guide point |
# | `map_age` | age / 2 s, clipped to $[0, 1]$ |
# | `preference` | 0 all safety, 1 all thrift |
#
# Sine and cosine, since an angle jumps from $\pi$ to $-\pi$ just behind the robot. Where $d = 0$: sine 0, cosine 1, as
# straight ahead.
#
# **Exercise `paint_bands`** (medium, important, 15 minutes). Band k fills rows `BAND_EDGES[k]` to `BAND_EDGES[k + 1]`, the
# last one excluded. `ego.twist` is v [m/s], omega [rad/s]; `ego.goal_robot` and `ego.guide_robot` are x ahead, y to the
# left [m]; `ego.battery`, `ego.map_age_s` [s] and `ego.preference` are numbers.

# %% grade_id="paint_bands" tags=["solution"]
def paint_bands(ego: Ego):
    """(64, 64) image of the robot's own ten numbers, in the order of BANDS."""

    ### BEGIN SOLUTION
    def bearing(point):
        distance = np.hypot(point[0], point[1])
        return (point[1] / distance, point[0] / distance) if distance > 1e-9 else (0.0, 1.0)

    distance = np.hypot(*ego.goal_robot)
    numbers = [
        np.clip(ego.twist[0] / SPEED_SCALE, -1.0, 1.0),
        np.clip(ego.twist[1] / TURN_SCALE, -1.0, 1.0),
        ego.battery,
        distance / (distance + GOAL_SCALE),
        *bearing(ego.goal_robot),
        *bearing(ego.guide_robot),
        np.clip(ego.map_age_s / AGE_SCALE, 0.0, 1.0),
        ego.preference,
    ]
    image = np.empty((SIZE, SIZE), np.float32)
    for k, number in enumerate(numbers):
        image[BAND_EDGES[k] : BAND_EDGES[k + 1]] = number
    return image
    ### END SOLUTION


# %% grade_id="paint_bands_check" points=4 tags=["check"]
check("paint_bands", paint_bands)


# %% [markdown]
# ## 3. `project_intensity`: how bright was the echo
#
# The article's fourth channel (its 4.4). Beam k points at $\theta_k = -\pi + 2\pi k / \text{beams}$ and ends at
# $x = r\cos\theta$ ahead and $y = r\sin\theta$ to the left. Its cell is
#
# $$\text{row} = \lfloor 32 - 10\,x \rfloor \qquad \text{column} = \lfloor 32 - 10\,y \rfloor$$
#
# **Exercise `project_intensity`** (medium, 10 minutes). `scan` is `(beams, 2)`: range [m], intensity. Where several beams
# end in one cell the strongest counts; what lies beyond the image leaves no trace. Values in [0, 1].

# %% grade_id="project_intensity" tags=["solution"]
def project_intensity(scan):
    """(64, 64) strongest intensity of the beams that end in each cell."""
    ### BEGIN SOLUTION
    ranges, intensities = np.asarray(scan, float).T
    angles = -np.pi + 2.0 * np.pi * np.arange(len(ranges)) / len(ranges)
    rows = np.floor(SIZE / 2 - ranges * np.cos(angles) / CELL_M).astype(int)
    columns = np.floor(SIZE / 2 - ranges * np.sin(angles) / CELL_M).astype(int)
    inside = (rows >= 0) & (rows < SIZE) & (columns >= 0) & (columns < SIZE)
    image = np.zeros((SIZE, SIZE), np.float32)
    np.maximum.at(image, (rows[inside], columns[inside]), np.clip(intensities[inside], 0.0, 1.0))
    return image
    ### END SOLUTION


# %% grade_id="project_intensity_check" points=3 tags=["check"]
check("project_intensity", project_intensity)


# %% [markdown]
# ## 4. `encode_state`: put it together
#
# | channel | what | from |
# |---|---|---|
# | 0 | static semantics: free 0, unknown 1/6, door 1/3, furniture 2/3, wall 1 | `map_crop` |
# | 1 | where movers will be in the next 2 s | `motion_channel(scans, poses, ego)`, given above |
# | 2 | the ten bands | `paint_bands` |
# | 3 | intensity of the newest scan | `project_intensity` |
#
# The order matters: the network's weights belong to it. (The article adds a batch axis here and then joins a 4-D with a
# 3-D tensor, which raises.)
#
# **Exercise `encode_state`** (easy, very important, 5 minutes). `scans` are `(3, 1080, 2)`, oldest first, `poses` `(3, 3)`,
# `map_crop` `(64, 64)`. Float32, no batch axis.

# %% grade_id="encode_state" tags=["solution"]
def encode_state(scans, poses, map_crop, ego: Ego):
    """(4, 64, 64) float32, what the policy sees."""
    ### BEGIN SOLUTION
    channels = [map_crop, motion_channel(scans, poses, ego), paint_bands(ego), project_intensity(scans[-1])]
    return np.stack(channels).astype(np.float32)
    ### END SOLUTION


# %% grade_id="encode_state_check" points=4 tags=["check"]
check("encode_state", encode_state)

# %% [markdown]
# ## 5. Plug it in
#
# The environment calls your encoder at each step. Beside it runs the library's, on the same numbers.

# %%
differences, seen = [], []


def watched(scans, poses, map_crop, ego):
    """Your encoder, with the library's beside it."""
    image = encode_state(scans, poses, map_crop, ego)
    differences.append(np.abs(image - library_encoder(scans, poses, map_crop, ego)).max())
    seen.append(image)
    return image


run = drive(planned("cv_sampling"), "crowd_crossing", seed=3, steps=30 if quick else 400, encoder=watched)
print(f"{len(differences)} images, largest difference {max(differences):.2f}")


# %% [markdown]
# What the policy saw, as a film. Map and echoes: black is 0, bright is 1. Movers and bands: red above 0, blue below.
# Find the moment at which the group sets off.

# %%
def draw_channels(image):
    """The four channels side by side."""
    figure, axes = plt.subplots(1, 4, figsize=(11, 3.2))
    for k, (axis, values) in enumerate(zip(axes, image, strict=True)):
        low, colours = (-1.0, "RdBu_r") if k in (1, 2) else (0.0, "magma")
        axis.imshow(values, cmap=colours, vmin=low, vmax=1.0, extent=(3.2, -3.2, -3.2, 3.2))
        axis.set(title=("map", "where movers will be", "ten bands", "echoes")[k], xlabel="to the left [m]")
        axis.grid(False)
    axes[0].set_ylabel("ahead [m]")
    axes[2].set(xticks=[], yticks=[], xlabel="a stripe a number")
    return figure


display(film([photo(draw_channels(image)) for image in seen[:: 15 if quick else 6]], 300, 900))

# %% [markdown]
# Ask the bands what the robot knew, and compare the first image's with the table of part 2:

# %%
for name, row in zip(BANDS, BAND_EDGES, strict=False):
    print(f"{name:<14}{seen[0][2, row, 0]:6.2f}")
print(f"largest difference of all images: {max(differences):.2f}")
# expect: largest difference of all images: 0.00

# %% [markdown]
# ## Change this one line and look
#
# - `"crowd_crossing"` in part 5: with `"low_light"`, which channel gets worse?
# - In `motion_channel`, `Motion(method=method)`: with `Motion(method="farneback")` the channel shows optical flow.
# - `GOAL_SCALE = 2.0`: with 20, how well can the bands tell 0.5 m from 1 m? (The check wants 2.)
#
# Source: the article's 2.2 and 4.4; this kit's `encoder.py` has the layout in one table.
