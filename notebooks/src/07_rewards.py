# %% [markdown]
# # 07 Rewards: say what you want
#
# **Aim**: write the five reward terms that the robot learns from, and see why the article's own terms teach it to crash.
#
# **Time**: 40 minutes for you, 10 s of CPU. **Number to expect**: under the article's reward a crash is worth
# **-77** and an arrival **-643**; under yours **-11.1** and **7.0**.
#
# A reward is the only thing a learning robot is ever told. It does not guess what you meant. So read a reward the way
# the laziest robot would: *what is the cheapest way to collect this?*

# %% tags=["parameters"]
quick = False  # the tests run this notebook with fewer pictures

# %% tags=["given"]
import numpy as np

from dualnav_lite.check import check
from dualnav_lite.rewards import Transition

GAMMA = 0.99  # the trainer's discount
SAFE_DISTANCE = 0.3  # [m], article 4.2
ENERGY_SCALE = 0.04  # what a step at full speed costs
GOAL_SCALE = 10.0  # [1/m], a metre of way

# %%
import matplotlib.pyplot as plt
import pandas as pd
from IPython.display import display

from dualnav_lite.config import Config, with_overrides
from dualnav_lite.figures.lesson import BLUE, GREEN, ORANGE, RED, drive, film, lesson_style, planned
from dualnav_lite.figures.play import sliders
from dualnav_lite.rewards import WindowScore

lesson_style()

# %% [markdown]
# ## 1. Three robots and the article's reward
#
# The article's section 2.3 adds up four terms, with $d$ the smallest range of the scan and $D$ the distance to the goal:
#
# $$r_{safe} = -10\, d \qquad r_{energy} = -2\,(|v| + 0.5\,|\omega|) \qquad r_{goal} = 3\, e^{-D/5}$$
#
# and $r_{dynamic}$, which is 0 in this empty room. Three robots collect it: one *parks*, one *crashes* straight ahead,
# one *arrives* (A\* drives). What each is worth is the discounted return $G = \sum_t \gamma^t r_t$, which PPO maximises.

# %%
SEED = 54  # an empty room
DRIVERS = {
    "parks": lambda config: lambda observation, info: (0.0, 0.0),
    "crashes": lambda config: lambda observation, info: (0.8, 0.0),
    "arrives": lambda config: planned("astar", config),
}


def discounted(rewards, gamma=GAMMA):
    """G of a run: what comes later counts less."""
    return float(np.sum(np.asarray(rewards) * gamma ** np.arange(len(rewards))))


def three_robots(form, **parts):
    """What each driver is worth under a reward; `parts` may bring a reward function of your own."""
    config = with_overrides(Config(), {"rewards.form": form})
    runs = {name: drive(make(config), seed=SEED, config=config, **parts) for name, make in DRIVERS.items()}
    rows = {
        name: {"outcome": run["outcome"], "steps": len(run["table"]), "G": discounted(run["table"].reward)}
        for name, run in runs.items()
    }
    return pd.DataFrame(rows).T.astype({"G": float}).round(1)


article = three_robots("article")
print(", ".join(f"{name} {row.G:.0f}" for name, row in article.iterrows()))
# expect: parks -626, crashes -77, arrives -643
article


# %% [markdown]
# The crash wins, by far, and arriving comes last. Two mistakes work together. The sign of $r_{safe}$ is turned round:
# 5 m of room cost 50, 0.1 m costs 1. And every step costs something, so the run that ends first costs least.
#
# PPO would find this out within minutes. It would be right, too: this is what we asked for.
#
# ## 2. `safe`: a penalty where it is close, nothing elsewhere
#
# The article mends the term in its section 4.2, with $c$ the *clearance*: from the hull, not from the lidar's middle.
#
# $$r_{safe}(c) = -10\,\max(0,\ 0.3 - \max(0, c))^2$$
#
# **Exercise `safe`** (easy, important, 5 minutes). A number or an array [m]; a negative clearance counts as 0.

# %% grade_id="safe" tags=["solution"]
def safe(clearance):
    """Penalty in [-0.9, 0] of a clearance [m], a number or an array."""
    ### BEGIN SOLUTION
    missing = np.clip(SAFE_DISTANCE - np.asarray(clearance, float), 0.0, SAFE_DISTANCE)
    return -10.0 * missing**2
    ### END SOLUTION


# %% grade_id="safe_check" points=2 tags=["check"]
check("safe", safe)

# %%
clearance = np.linspace(0.0, 1.0, 101)  # [m]
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 2.6))
left.plot(clearance, -10.0 * clearance, color=RED)
left.set(title="article 2.3: the more room, the worse", xlabel="smallest range [m]", ylabel="r_safe a step")
right.plot(clearance, safe(clearance), color=BLUE)
right.set(title="yours", xlabel="clearance of the hull [m]", ylabel="r_safe a step")
plt.show()


# %% [markdown]
# ## 3. `goal`: pay for progress, not for being near
#
# $3 e^{-D/5}$ is paid at every step, so a robot that waits next to the goal collects it for ever; one that arrives gets
# nothing more. Near the goal that is worth up to 298 (discounted, over the article's 500 steps).
#
# The cure is a *potential* $\Phi$ (Ng, Harada, Russell 1999): pay only its change.
#
# $$r_{goal} = \gamma\,\Phi(s') - \Phi(s), \qquad \Phi = -10 \cdot \text{way to the goal [m]}, \quad \Phi = 0 \text{ at arrival}$$
#
# The *way* runs along free space: through the door, not through the wall. With the trainer's $\gamma$ the discounted sum
# over a run telescopes to $\gamma^T \Phi(s_T) - \Phi(s_0)$: nothing the robot does on the way can change it, so the best
# policy stays the best. (Strictly, $\Phi$ must be 0 at *every* end for that. Here a crash keeps the $\Phi$ of the place
# where it happened, which only makes it more expensive.) With $\gamma = 1$ a metre is worth the same whenever it is driven. The
# kit takes 1; part 6 says why.
#
# **Exercise `goal`** (medium, important, 10 minutes). `before` and `after` are metres, `reached` is a bool; or arrays of
# them. `gamma` is a number, whichever the caller wants.

# %% grade_id="goal" tags=["solution"]
def goal(before, after, reached, gamma):
    """Shaping reward of a step that led from `before` to `after` metres of way."""
    ### BEGIN SOLUTION
    potential_after = np.where(reached, 0.0, -GOAL_SCALE * np.asarray(after, float))
    return gamma * potential_after - -GOAL_SCALE * np.asarray(before, float)
    ### END SOLUTION


# %% grade_id="goal_check" points=3 tags=["check"]
check("goal", goal)

# %% [markdown]
# Watch the two on one walk: towards the goal, ten seconds of waiting 0.6 m in front of it, then the last bit.

# %%
way = np.concatenate([np.arange(5.0, 0.6, -0.08), np.full(100, 0.6), np.arange(0.6, 0.3, -0.08)])  # [m]
reached = way[1:] < 0.4
progress = goal(way[:-1], way[1:], reached, 1.0)
figure, axis = plt.subplots(figsize=(9, 2.6))
seconds = 0.1 * np.arange(1, len(way))
axis.plot(seconds, np.cumsum(3.0 * np.exp(-way[1:] / 5.0)), color=RED, label="article: 3 exp(-D/5)")
axis.plot(seconds, np.cumsum(progress), color=BLUE, label="yours, gamma 1")
axis.axvspan(5.6, 15.6, color=ORANGE, alpha=0.15, label="waiting")
axis.set(xlabel="time [s]", ylabel="collected so far")
axis.legend()
plt.show()
print(f"waiting pays {3.0 * np.exp(-0.6 / 5.0) * 100:.0f} in the article, {progress[56:150].sum():.1f} in yours")
# expect: waiting pays 266 in the article, 0.0 in yours

# %% [markdown]
# ## 4. `reward_terms`: all five, apart
#
# Two objectives must stay visible, so a step is worth five *named* numbers; the weighted sum comes later.
#
# | term | from | value |
# |---|---|---|
# | `safe` | `t.clearance` [m] | your `safe` |
# | `dynamic` | `t.intrusion` in [0, 1]: how far the robot will drive into where people are going to be | $-$intrusion |
# | `energy` | `t.energy_j` [J], `t.reference_j` [J] of a step at full speed | $-0.04\, E / E_{ref}$ |
# | `goal` | `t.path_before`, `t.path_after` [m], `t.reached` | your `goal` with gamma 1; part 6 says why |
# | `terminal` | `t.reached`, `t.collided`, `t.flat_battery` | arrival $+10$, failure $-10$, else $0$ |
#
# Energy is in joules. The article's $|v| + 0.5|\omega|$ is the same for every speed over a given way, so no robot can
# learn thrift from it. And without `terminal` a crash is a way out of the penalties.
#
# **Exercise `reward_terms`** (medium, very important, 10 minutes). Each field in the table is one number or one bool. Return
# a dictionary with these five keys. A contact on arrival is a failure.

# %% grade_id="reward_terms" tags=["solution"]
def reward_terms(t: Transition) -> dict:
    """The five terms of a step, before any weight."""
    ### BEGIN SOLUTION
    has_failed = t.collided or t.flat_battery
    return {
        "safe": safe(t.clearance),
        "dynamic": -t.intrusion,
        "energy": -ENERGY_SCALE * t.energy_j / t.reference_j,
        "goal": goal(t.path_before, t.path_after, t.reached, 1.0),
        "terminal": -10.0 if has_failed else 10.0 if t.reached else 0.0,
    }
    ### END SOLUTION


# %% grade_id="reward_terms_check" points=4 tags=["check"]
check("reward_terms", reward_terms)


# %% [markdown]
# ## 5. `reward_weights`: whose life matters more just now
#
# The article prints weights 0.45, 0.25, 0.20, 0.10 in a table, and its code adds the terms without them. Here they count,
# and two of them move. The *preference* $p$ goes from 0, all safety, to 1, all thrift; $b$ is the charge in [0, 1]:
#
# $$w_{safe} = 0.45 \cdot 2(1 - p) \qquad w_{energy} = 0.20 \cdot 2p \cdot (1 + 3(1 - b))$$
#
# The others stay: dynamic 0.25, goal 0.10, terminal 1. At $p = 0.5$ and full charge these are the article's.
#
# **Exercise `reward_weights`** (easy, 5 minutes). In the order of the table above, an array of five.

# %% grade_id="reward_weights" tags=["solution"]
def reward_weights(preference, charge):
    """(5,) weights of safe, dynamic, energy, goal, terminal."""
    ### BEGIN SOLUTION
    w_safe = 0.45 * 2.0 * (1.0 - preference)
    w_energy = 0.20 * 2.0 * preference * (1.0 + 3.0 * (1.0 - charge))
    return np.array([w_safe, 0.25, w_energy, 0.10, 1.0])
    ### END SOLUTION


# %% grade_id="reward_weights_check" points=2 tags=["check"]
check("reward_weights", reward_weights)

# %% [markdown]
# ## 6. Plug it in
#
# The environment takes your function in place of its own. The same three robots again:

# %%
mine = three_robots("repaired", reward_function=reward_terms)
print(", ".join(f"{name} {row.G:.1f}" for name, row in mine.iterrows()))
# expect: parks -0.2, crashes -11.1, arrives 7.0
mine

# %% [markdown]
# Now arriving wins, crashing loses, and parking earns nothing but the bill for its idle electronics.
#
# Why gamma 1? With the trainer's $\gamma = 0.99$ in `goal` the *best* policy would stay the best, and still PPO would not
# find it. A robot that stands at way $d$ would be paid $10\,(1 - \gamma)\,d$ at every step, interest on its potential, and
# a metre of driving would pay no more than the interest it loses. A beginner that cannot yet arrive has no reason to move.
#
# Lesson 11's training after 600,000 steps: with 0.99, 6 to 9 % of the last 100 runs arrived; with 1, 92 %. The price is
# the proof, which needs the trainer's $\gamma$: going to and fro now pays a little, less than a third of arriving.
# (`training/record.yaml` keeps 0.99. Its policy was taught to arrive before it met a reward.)
#
# The terms of the run that arrives, one by one: which of them speaks, and when?

# %%
run = drive(planned("cv_sampling"), "crowd_reactive", seed=4, reward_function=reward_terms, every=0 if quick else 3)
table, names = run["table"], ["safe", "dynamic", "energy", "goal"]
figure, axes = plt.subplots(1, 4, figsize=(12, 2.3))
for axis, name, colour in zip(axes, names, (BLUE, RED, ORANGE, GREEN), strict=True):
    axis.plot(table.time_s, table[name], color=colour)
    axis.set(title=name, xlabel="time [s]")
axes[0].set_ylabel("reward a step")
plt.show()
if run["pictures"] and not quick:
    display(film(run["pictures"]))

# %% [markdown]
# And what is the sum worth? The same run and one that parks, under your weights. Where does the safe term win over the
# energy, and when is it better to stay at home?

# %%
parked = drive(DRIVERS["parks"](None), "crowd_reactive", seed=4, reward_function=reward_terms)["table"]
TERM_NAMES = ["safe", "dynamic", "energy", "goal", "terminal"]


def weighed(preference, charge):
    """Discounted worth of each term, for the run that arrives and the one that parks."""
    weights = reward_weights(preference, charge)
    _, axis = plt.subplots(figsize=(8, 2.8))
    for k, (name, one, colour) in enumerate((("arrives", table, GREEN), ("parks", parked, ORANGE))):
        worth = np.array([discounted(one[term]) for term in TERM_NAMES]) * weights
        axis.bar(np.arange(5) + 0.4 * k - 0.2, worth, 0.4, color=colour, label=f"{name}: {worth.sum():.1f} in all")
    axis.axhline(0, color="gray", linewidth=1)
    axis.set_xticks(range(5), [f"{name}\nx {weight:.2f}" for name, weight in zip(TERM_NAMES, weights, strict=True)])
    axis.set(ylabel="discounted worth", title=f"preference {preference:.1f}, charge {charge:.1f}")
    axis.legend()
    plt.show()


weighed(preference=0.5, charge=1.0)

# %% [markdown]
# The arrival's 10 comes so late that the discount has eaten most of it: the metres on the way make up for it, and driving
# through a crowd has its price. Where does your weighing tip the balance?
#
# With sliders: move one and let go. (No sliders? Change the numbers in the call above.)

# %%
sliders(weighed, preference=(0.0, 1.0, 0.1, 0.5), charge=(0.0, 1.0, 0.1, 1.0))

# %% [markdown]
# ## 7. The z-score trap
#
# The article's 4.1 divides each term by the spread of its last 100 values, *after taking their mean away*. Three robots,
# 100 steps each: always at 2 m, always at 0.02 m, and once at contact.

# %%
quiet = {name: np.zeros(3) for name in ("dynamic", "energy", "goal", "terminal")}
scorer, scored = WindowScore(3), []
for step in range(100):
    last = 0.0 if step == 99 else 2.0
    scored.append(scorer({"safe": safe(np.array([2.0, 0.02, last]))} | quiet)["safe"])
print("score of the last step:", ", ".join(f"{one:.1f}" for one in np.round(scored[-1], 1) + 0.0))
# expect: score of the last step: 0.0, 0.0, -9.9

# %% [markdown]
# Always safe and always unsafe score the same: nothing. And the contact gets -9.9 whether it costs 0.9 or 900. The
# trainer of this kit scales by a running deviation and **keeps the mean** (lesson 11).
#
# ## Change this one line and look
#
# - `GOAL_SCALE = 10.0` in the second cell: try 0.1, run all, and look who wins in part 6. (The check of `goal` will
#   complain: it wants 10.)
# - In `reward_terms`, make the contact cost 0 in place of 10. Which robot is better off now?
# - `SEED = 54`: rooms 7 and 40. How soon can a robot crash?
#
# Papers: Ng, Harada, Russell, *Policy invariance under reward transformations*, ICML 1999, eq. 2; Grzes, *Reward shaping
# in episodic reinforcement learning*, AAMAS 2017, for $\Phi$ at the end.
