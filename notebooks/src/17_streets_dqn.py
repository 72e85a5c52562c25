# %% [markdown]
# # 17 Streets: the same two objectives, a few actions
#
# **Aim**: find ways through a town that weigh risk against distance, once exactly and once by learning (DQN), and say
# what learning was good for.
#
# **Time**: 30 minutes for you, 25 s of CPU. **Number to expect**: at half past six in the evening the shortest way is
# **1299 m** with a risk of **39.9**; a detour of 467 m brings the risk down to **24.4**.
#
# The article that this kit follows opens with another robot: one that walks through a city, and trades *crime risk*
# against *distance*. It is the same question as everywhere in this kit (two objectives that pull apart), only that the
# choice at a crossing is one of a few streets, not a speed and a turn. For a few choices there is deep Q-learning, DQN.

# %% tags=["parameters"]
quick = False  # the tests train for a few seconds only

# %% tags=["given"]
import numpy as np
import torch

from dualnav_lite.check import check

# %%
import matplotlib.pyplot as plt
import pandas as pd

from dualnav_lite.beyond.streets import BLOCK_M, SIDE, build_town, exact_walk, risk_density, weigh
from dualnav_lite.beyond.streets_dqn import GOAL, draw_trips, train_walker, walks_of_network
from dualnav_lite.figures.lesson import BLUE, GREEN, GREY, ORANGE, RED, lesson_style

lesson_style()
torch.set_num_threads(1)
town = build_town(0)


# %% [markdown]
# ## 1. A town that changes with the hour
#
# 49 junctions, 74 streets. Risk is the expected number of incidents in a thousand walks; it gathers at a market around
# one o'clock, at a park in the evening, in a quarter of bars at night. Home is the corner at the top right.

# %%
def show_town(axis, hour):
    """Streets over the risk at an hour of the day; what it drew, for a scale."""
    edge = np.linspace(-0.5 * BLOCK_M, (SIDE - 0.5) * BLOCK_M, 80)
    x, y = np.meshgrid(edge, edge)
    risk = risk_density(np.stack([x, y], axis=-1), 60.0 * hour)
    shown = axis.pcolormesh(x, y, risk, cmap="OrRd", vmin=0, vmax=7, shading="auto", alpha=0.8)
    for here, there in zip(*np.nonzero(town.neighbours >= 0), strict=True):
        ends = town.places[[here, town.neighbours[here, there]]]
        axis.plot(*ends.T, color=GREY, linewidth=1)
    axis.plot(*town.places[GOAL], marker="*", color=GREEN, markersize=14)
    axis.set(title=f"{int(hour) % 24:02d}:{round(60 * hour) % 60:02d}", aspect="equal", xlabel="x [m]")
    axis.grid(False)
    return shown


figure, axes = plt.subplots(1, 3, figsize=(12, 4.2), sharey=True)
for axis, hour in zip(axes, (13, 19, 0), strict=True):
    shown = show_town(axis, hour)
axes[0].set_ylabel("y [m]")
figure.colorbar(shown, ax=axes, label="incidents in 1,000 walks of 100 m", shrink=0.8)
plt.show()

# %% [markdown]
# ## 2. Exact ways
#
# A *preference* $p$ joins both objectives into one number, metres for $p = 1$, risk for $p = 0$ (an incident in a thousand
# walks weighs as much as 60 m):
#
# $$c = p \cdot \text{metres} + (1 - p) \cdot 60 \cdot \text{risk}$$
#
# The risk of a street depends on *when* one is there. So the exact answer is a shortest path in a graph of junctions
# **times minutes**: Dijkstra finds it, `exact_walk`. This is a luxury: whoever knows the whole town, the risk at every
# hour included, need not learn.

# %%
START, MINUTE = 0, 18 * 60 + 30


def front(start, minute, preferences=(0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)):
    """Exact ways for several preferences."""
    return {p: exact_walk(town, start, GOAL, minute, p) for p in preferences}


evening = front(START, MINUTE)
print(f"shortest way: {evening[1.0].metres:.0f} m, risk {evening[1.0].risk:.1f}")
print(f"safest way: {evening[0.0].metres:.0f} m, risk {evening[0.0].risk:.1f}")
# expect: shortest way: 1299 m, risk 39.9
# expect: safest way: 1766 m, risk 24.4

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.4))
show_town(left, MINUTE / 60)
for p, colour in ((1.0, BLUE), (0.5, ORANGE), (0.0, GREEN)):
    left.plot(*town.places[list(evening[p].junctions)].T, color=colour, linewidth=3, label=f"p = {p}")
left.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=3)
left.set_ylabel("y [m]")
right.plot([w.metres for w in evening.values()], [w.risk for w in evening.values()], "o-", color=BLUE)
right.set(title="the exact front", xlabel="distance [m]", ylabel="risk [incidents in 1,000 walks]")
plt.show()


# %% [markdown]
# Nobody can be better in both than a point of this front.
#
# ## 3. Learn it
#
# The walker of this part knows no map and no timetable. It sees where it is, the hour, its preference, and the length
# and present risk of the streets that leave from here. $Q(s, a)$ is what street $a$ will have been worth once home; the
# best street is the one with the largest Q, and each step teaches one number:
#
# $$y = r + \gamma\, Q'\!\left(s', \arg\max_{a'} Q(s', a')\right) \qquad \text{or just } r \text{ at home}$$
#
# One network chooses the next street, a slower copy $Q'$ says what it is worth (*double* Q-learning): a network that
# does both believes its own luckiest mistake. `dqn.py` is one page; read its table of details.
#
# **Exercise `td_target`** (medium, important, 10 minutes). Tensors: `values` (n, streets) of the first network in the next
# states, `slow_values` of the copy, `rewards` and the bools `terminated` (home) (n,); `gamma` is a number. A street that does
# not exist has the value $-\infty$ in both, and at home that may be all of them.

# %% grade_id="td_target" tags=["solution"]
def td_target(values, slow_values, rewards, terminated, gamma):
    """(n,) what Q(s, a) should have been."""
    ### BEGIN SOLUTION
    best = values.argmax(dim=1, keepdim=True)
    following = slow_values.gather(1, best)[:, 0]
    return rewards + gamma * torch.where(terminated, torch.zeros_like(following), following)
    ### END SOLUTION


# %% grade_id="td_target_check" points=3 tags=["check"]
check("td_target", td_target)

# %% [markdown]
# Learn with it:

# %%
steps = 3_000 if quick else 60_000
returns = []  # of the walks that ended, in the order in which they did


def note(infos, share):
    """Keep how far above the straight line each finished walk was."""
    for start, goal, _, preference, metres, risk, _ in infos.get("walks", ()):
        straight = np.hypot(*(town.places[start] - town.places[goal]))
        returns.append((share * steps, weigh(metres, risk, preference) / straight))


network = train_walker(town, steps, on_step=note, targets=td_target)
learned = pd.DataFrame(returns, columns=["step", "cost"])
smooth = learned.cost.rolling(200, min_periods=20).median()
figure, axis = plt.subplots(figsize=(7, 2.8))
axis.plot(learned.step, smooth, color=BLUE)
axis.set(xlabel="streets walked while learning", ylabel="cost a straight metre", yscale="log")
axis.minorticks_off()
axis.set_yticks([1, 2, 5, 10], ["1", "2", "5", "10"])
plt.show()

# %% [markdown]
# ## 4. How good is it?
#
# Starts and minutes drawn from a tuning seed (lesson 11): you may look at these as often as you like. The walks behind
# the published table are others, and nobody learns or chooses on them. The measure is the *excess* over the exact way,
# of the walks that arrive; how many do is the first column.

# %%
trips = draw_trips(town, 10 if quick else 60, seed=1_050_000)
rows = []
for p in (0.0, 0.5, 1.0):
    walks = walks_of_network(network, town, trips, p)
    for (start, goal, minute), (metres, risk, arrived) in zip(trips, walks, strict=True):
        best = exact_walk(town, start, goal, minute, p)
        excess = weigh(metres, risk, p) / weigh(best.metres, best.risk, p) - 1.0
        numbers = (metres, risk, best.metres, best.risk, 100 * excess)
        rows.append((p, arrived, *(numbers if arrived else [np.nan] * 5)))
names = ["preference", "arrived", "metres", "risk", "exact metres", "exact risk", "excess %"]
judged = pd.DataFrame(rows, columns=names)
table = judged.groupby("preference").mean().round(2)
table

# %%
figure, axis = plt.subplots(figsize=(6, 3.6))
axis.plot(table["exact metres"], table["exact risk"], "o-", color=GREY, label="exact")
axis.plot(table.metres, table.risk, "s--", color=RED, label="DQN")
axis.set(xlabel="mean distance [m]", ylabel="mean risk [in 1,000 walks]", title="one network, the whole front")
axis.legend()
plt.show()

# %% [markdown]
# A network of 34,000 numbers carries, for each hour and each preference, what Dijkstra computes anew for each walk. It had
# to pay 60,000 streets for it, and knows one goal. Where the world is known and small, **plan**; where it must be met to
# be known, **learn**. In between (this kit's robot) one does both.
#
# Several seeds with intervals, and a planner that takes the risk at departure for the whole walk:
# `python kit.py beyond streets`; the numbers stand in `stress_tests/reference/beyond`.
#
# ## Change this one line and look
#
# - `MINUTE` in part 2: at which hour is the shortest way also the safest?
# - `steps` in part 3: how few streets are enough for 5 % of excess?
# - `goals=None` as one more argument of `train_walker`: any goal, not only home. How much more must be learned?
#
# Papers: Mnih et al., *Human-level control through deep reinforcement learning*, Nature 518 (2015), algorithm 1; van
# Hasselt, Guez, Silver, *Deep reinforcement learning with double Q-learning* (2016), eq. 4; Ng, Harada, Russell, *Policy
# invariance under reward transformations* (1999), theorem 1 (why the reward may say that home comes nearer).
