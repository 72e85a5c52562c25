# %% [markdown]
# # Start here: one robot, two objectives
#
# **Aim**: drive the robot, let a planner drive it, and see what a policy would see.
#
# **Time**: 3 minutes for you, 8 s of CPU; twice that with parts 5 and 6. **Number to expect**: two seconds of waiting
# buy **0.13 m** of room for **10 J**.
#
# Run a cell with Shift + Enter; nothing can break. The robot must reach its goal without touching anything, **and** spend
# little energy. Keep both numbers in view: the *safe distance* (how close the hull came to anything, in metres) and the
# *energy* (in joules).
#
# **中文读者**：课文目前是英文，检查给出的提示有中文。把下面的 `set_language()` 改成 `set_language("zh")` 并运行，本文件夹的所有课都会用中文提示。
# 安装与命令见 [README.zh-CN.md](../README.zh-CN.md)，中英术语对照见 [GLOSSARY.md](GLOSSARY.md)。

# %% tags=["parameters"]
quick = False  # the tests run this notebook with fewer pictures

# %%
from dualnav_lite.check import set_language

set_language()  # "zh" 中文

# %%
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from IPython.display import display
from PIL import Image

from dualnav_lite.config import Config, with_overrides
from dualnav_lite.figures.lesson import BLUE, ORANGE, RED, drive, film, lesson_style, planned
from dualnav_lite.figures.play import HandDriver

lesson_style()
SEED = 207  # of the room

# %% [markdown]
# ## 1. Drive it yourself
#
# Ten times a second the robot takes two numbers: a speed v (0.8 m/s at most) and a turning rate omega (1.2 rad/s at
# most, positive is to the left). Below is a list of them. Does it arrive?

# %%
commands = [  # v [m/s], omega [rad/s], for so many seconds
    (0.0, -1.0, 3.0),
    (0.6, 0.0, 14.0),
]


def by_hand(commands):
    """A robot that was driven like this."""
    hand = HandDriver(seed=SEED)
    for command in commands:
        hand.go(*command)
    return hand


mine = by_hand(commands)
display(Image.fromarray(mine.picture()))
print(mine.words())
# expect: hit_person after 6.7 s: safe distance 0.00 m, energy 107 J

# %% [markdown]
# On the left the room: the robot with its trail, the lidar's hits in red, the goal in green, the way to it in dots.
# On the right what a policy gets to see, nothing else.
#
# Turn a tenth of a second longer. And then wait two seconds first:

# %%
turned = by_hand([(0.0, -1.0, 3.1), (0.6, 0.0, 14.0)])
waited = by_hand([(0.0, 0.0, 2.0), (0.0, -1.0, 3.1), (0.6, 0.0, 14.0)])
print(f"turned: {turned.words()}\nwaited: {waited.words()}")
gained, paid = np.subtract(waited.point, turned.point)
print(f"waiting buys {gained:.2f} m of room for {paid:.0f} J")
# expect: turned: goal after 12.7 s: safe distance 0.07 m, energy 209 J
# expect: waited: goal after 14.7 s: safe distance 0.20 m, energy 219 J
# expect: waiting buys 0.13 m of room for 10 J

# %% [markdown]
# Room for joules: that is the trade this kit is about. Now you, at the wheel. Set the sliders, press a button, and look
# where the people go. (No sliders? Change `commands` above and run that cell again.)

# %%
HandDriver(seed=SEED).panel()


# %% [markdown]
# ## 2. Let a planner drive
#
# `astar` plans a path on the map that the robot builds while it drives, and follows it. Same room, same start.

# %%
def show(run):
    """A run as a film, or its last picture, then its clearance and energy over time; both numbers in words."""
    display(film(run["pictures"], width=840) if len(run["pictures"]) > 2 else Image.fromarray(run["pictures"][-1]))
    table = run["table"]
    _, (left, right) = plt.subplots(1, 2, figsize=(9.6, 2.4))
    left.plot(table.time_s, table.clearance_m, color=BLUE)
    left.axhline(0, color=RED, linewidth=1)
    left.set(title="how close", xlabel="time [s]", ylabel="clearance [m]")
    right.plot(table.time_s, table.energy_j, color=ORANGE)
    right.set(title="how expensive", xlabel="time [s]", ylabel="energy [J]")
    plt.show()
    print(f"{run['outcome']} after {table.time_s.iloc[-1]:.1f} s: ", end="")
    print(f"safe distance {max(0, table.clearance_m.min()):.2f} m, energy {table.energy_j.iloc[-1]:.0f} J")


astar = drive(planned("astar"), seed=SEED, every=1000 if quick else 3)
show(astar)
# expect: goal after 10.8 s: safe distance 0.03 m, energy 257 J

# %% [markdown]
# It passed somebody at 3 cm, since its map shows where people *are*, not where they will be.
#
# ## 3. See what a policy sees
#
# The four images on the right are all of it: 64 x 64 cells of 0.1 m, the robot in the middle, looking up (in the room:
# the dashed square). Five people are about to cross its way. *Motion* says where they will be; *intensity* is how much
# light came back.

# %%
crowd = drive(planned("astar"), "crowd_crossing", seed=1, steps=50, every=50)
display(Image.fromarray(crowd["pictures"][-1]))

# %% [markdown]
# (The static map shows people, too: what the lidar sees just now is laid over it. In the map itself nobody stays.)
#
# ## 4. Change one number and look
#
# An empty room, and one number: the top speed. Does a slower robot spend less?

# %%
slow_m_s = 0.5


def at_most(top_speed):
    """The run of a robot whose motors turn no faster."""
    slower = with_overrides(Config(), {"hardware.max_lin_vel": top_speed})
    return drive(planned("astar", slower), seed=19, config=slower)["info"]["summary"]


runs = {top_speed: at_most(top_speed) for top_speed in (0.8, slow_m_s)}
print(", ".join(f"{run['energy_j']:.0f} J at {top_speed} m/s" for top_speed, run in runs.items()))
# expect: 148 J at 0.8 m/s, 134 J at 0.5 m/s

# %% [markdown]
# That was the tour. [Lesson 01](01_world.ipynb) builds the robot; or stay three minutes more.
#
# ## 5. A second planner
#
# `cv_sampling` tries 99 commands ten times a second and assumes that everything that moves goes straight on. Who is
# safer, who is cheaper?

# %%
sampling = drive(planned("cv_sampling"), seed=SEED, every=1000)
show(sampling)
# expect: goal after 9.1 s: safe distance 0.27 m, energy 241 J

# %%
names = ["time_s", "path_m", "min_clearance_m", "mean_clearance_m", "energy_j"]
both = {"astar": astar["info"]["summary"], "cv_sampling": sampling["info"]["summary"]}
pd.DataFrame({arm: [episode[name] for name in names] for arm, episode in both.items()}, names).round(2)

# %% [markdown]
# `cv_sampling` is better in both numbers here: it *dominates*. But one run is an anecdote. `python kit.py stress` drives
# a thousand rooms a scenario, the same for each *arm* (whatever drives: a planner or a policy), and prints intervals.
#
# ## 6. More top speeds

# %%
for top_speed in () if quick else (0.65, 0.35, 0.2):
    runs[top_speed] = at_most(top_speed)
speeds = pd.DataFrame({v: [run[name] for name in names] for v, run in sorted(runs.items())}, names).T
speeds.index.name = "top speed [m/s]"
figure, axis = plt.subplots(figsize=(6, 3))
axis.plot(speeds.index, speeds.energy_j, marker="o", color=ORANGE)
axis.set(xlabel="top speed [m/s]", ylabel="energy to the goal [J]")
plt.show()
speeds.round(2)

# %% [markdown]
# Fast costs, and so does being switched on for long: the least lies near 0.5 m/s.
#
# ## Change this one line and look
#
# - `commands` in part 1: bring the robot to the goal yourself, by hand. Can you beat the planner in joules?
# - `SEED = 207`: another room.
# - `"crowd_crossing"` in part 3: `"pop_up"`, `"low_light"`, `"crowd_reactive"`.
# - `slow_m_s = 0.5` in part 4: 0.2. Slower, and yet more expensive.
