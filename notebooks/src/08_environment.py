# %% [markdown]
# # 08 Environment: your parts, one loop
#
# **Aim**: put your encoder and your rewards into a Gymnasium environment and write the loop that every agent lives in.
#
# **Time**: 30 minutes for you, 8 s of CPU. **Number to expect**: A\* arrives in **6** of 6 rooms, a driver that goes
# straight on in none; and the article's loop raises at its first step.

# %% tags=["parameters"]
quick = False  # the tests run this notebook without the film

# %% tags=["given"]
import numpy as np

from dualnav_lite.check import check

# %%
import warnings

import matplotlib.pyplot as plt
import pandas as pd
from gymnasium.utils.env_checker import check_env
from IPython.display import display

from dualnav_lite.env import DynamicNavEnv
from dualnav_lite.figures.lesson import BLUE, GREY, ORANGE, drive, film, lesson_style, planned
from dualnav_lite.parts import part

lesson_style()

# %% [markdown]
# ## 1. Your robot
#
# From earlier lessons: what passes there is used here, in place of the library's. If you got stuck, go on all the same.
# (Save the earlier notebook first: `part` reads the file. `python kit.py status`, or `status()` from
# `dualnav_lite.parts`, lists all parts and whose they are.)

# %%
encode_state = part("encode_state")
reward_terms = part("reward_terms")


def make_env(scenario="navigation", **settings):
    """An environment with your parts in it."""
    return DynamicNavEnv(scenario=scenario, encoder=encode_state, reward_function=reward_terms, **settings)


env = make_env()
print("observation", env.observation_space.shape, "action", env.action_space.high)

# %% [markdown]
# Gymnasium has its own inspector: spaces, seeds, types, whether `reset` and `step` give what they promise.

# %%
with warnings.catch_warnings(record=True) as complaints:
    warnings.simplefilter("always")
    check_env(env, skip_render_check=True)
for complaint in complaints:
    print(str(complaint.message).split("WARN: ")[-1].split(". See")[0])

# %% [markdown]
# One recommendation, which this kit declines on purpose: actions are *physical* here, m/s and rad/s inside the limits of
# the motors, and the policy's last layer scales to them. The article clips instead, and its robot spins at the bound.

# %% [markdown]
# And two promises that it does not look at. The same seed gives the same bytes; another seed another room.

# %%
first, second, third = (make_env().reset(seed=seed)[0] for seed in (7, 7, 8))
print(f"same seed: {np.abs(first - second).max():.1f}, other seed: {np.abs(first - third).max():.1f}")

# %% [markdown]
# ## 2. The article's loop
#
# Its section 3.2 reads, without the parts that learn:
#
# ```python
# state = env.reset()
# for t in range(500):
#     next_state, reward_dict, done, _ = env.step(action)
#     reward = sum(reward_dict.values())
#     state = next_state
# ```
#
# Watch it:

# %%
try:
    state = env.reset()
    for _ in range(500):
        next_state, reward_dict, done, _ = env.step(np.zeros(2))
        state = next_state
except ValueError as error:
    print(f"ValueError: {error}")


# %% [markdown]
# It raises under the very version that the article pins. Mend that line, and three mistakes remain: `state` holds a pair,
# since `reset` gives two values; nothing breaks out of the loop at `done`, so it goes on after the end; and an episode
# that is cut off by the clock looks like any other.
#
# **Exercise `closed_loop`** (easy, very important, 10 minutes). Drive one episode from `env.reset(seed=seed)` to its end.
# `choose(observation, info)` gives an action. Return a dictionary: `reward` (the sum), `steps`, and `ended`, which is
# `"terminated"` or `"truncated"`.

# %% grade_id="closed_loop" tags=["solution"]
def closed_loop(env, choose, seed):
    """One episode; what it earned, how long it took, how it ended."""
    ### BEGIN SOLUTION
    observation, info = env.reset(seed=seed)
    total, steps, terminated, truncated = 0.0, 0, False, False
    while not (terminated or truncated):
        observation, reward, terminated, truncated, info = env.step(choose(observation, info))
        total += reward
        steps += 1
    return {"reward": total, "steps": steps, "ended": "terminated" if terminated else "truncated"}
    ### END SOLUTION


# %% grade_id="closed_loop_check" points=4 tags=["check"]
check("closed_loop", closed_loop)

# %% [markdown]
# ## 3. Two numbers an episode
#
# The article prints `SafeDist` and `Energy`, never the reward alone. Three drivers, the same six rooms.

# %%
ROOMS = range(6)
DRIVERS = {
    "straight on": lambda: lambda observation, info: (0.5, 0.0),
    "A*": lambda: planned("astar"),
    "cv_sampling": lambda: planned("cv_sampling"),
}
rows = []
for name, make in DRIVERS.items():
    env = make_env()
    for room in ROOMS:
        run = closed_loop(env, make(), seed=room)
        numbers = {"clearance_m": env.episode_safe_dists[-1], "energy_j": env.episode_energy_costs[-1]}
        rows.append({"driver": name, "room": room, **run, **numbers})
    print(f"{name}: SafeDist={np.mean(env.episode_safe_dists):.2f}m | Energy={np.mean(env.episode_energy_costs):.0f}J")
table = pd.DataFrame(rows)
table.round(2)

# %%
figure, axis = plt.subplots(figsize=(7, 3))
for (name, one), colour in zip(table.groupby("driver", sort=False), (GREY, ORANGE, BLUE), strict=True):
    axis.plot(one.energy_j, one.clearance_m, "o", color=colour, label=name)
axis.set(xlabel="energy of the run [J]", ylabel="least clearance [m]")
axis.legend()
plt.show()
table["arrived"] = (table.ended == "terminated") & (table.clearance_m > 0)  # else it ended by a contact
arrived = table.groupby("driver", sort=False).arrived.sum()
print(f"of {len(ROOMS)} rooms: " + ", ".join(f"{name} {count}" for name, count in arrived.items()))
# expect: of 6 rooms: straight on 0, A* 6, cv_sampling 6

# %% [markdown]
# A run at the lower edge, clearance 0, is a contact. Up and to the left is better in both numbers; no driver is there in
# every room.

# %%
if not quick:
    picked = {"encoder": encode_state, "reward_function": reward_terms}
    display(film(drive(planned("cv_sampling"), seed=5, every=3, **picked)["pictures"]))

# %% [markdown]
# ## 4. A training program in under 50 lines
#
# Add a policy that learns in this loop, and that is the article's whole training program: `training/closed_loop.py` holds
# it, mended, in 42 lines. Lessons 09 to 11 fill it with life.
#
# ## Change this one line and look
#
# - `scenario="navigation"` in `make_env`: `"crowd_crossing"`, `"pop_up"`. Who still arrives?
# - `(0.5, 0.0)`, straight on: is 0.3 m/s safer? Does it spend less?
# - In `make_env`, leave `reward_function` out: do the rewards in the table change?
#
# Source: the article's 3.2; Gymnasium's environment interface.
