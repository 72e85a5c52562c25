# %% [markdown]
# # 09 Rollouts and GAE: was that better than expected?
#
# **Aim**: turn rewards and value guesses into *advantages*, the one number PPO learns from, and treat the two ways an
# episode can end differently.
#
# **Time**: 35 minutes for you, 5 s of CPU. **Number to expect**: a robot that earns 1 a step for ever is worth
# 100; whoever takes the clock for the end of the world learns **27**.

# %% tags=["parameters"]
quick = False  # the tests run this notebook with fewer samples

# %% tags=["given"]
import numpy as np

from dualnav_lite.check import check

# %%
import matplotlib.pyplot as plt

from dualnav_lite.config import Config
from dualnav_lite.env import DynamicNavVectorEnv, split_infos
from dualnav_lite.figures.lesson import BLUE, GREY, ORANGE, RED, lesson_style
from dualnav_lite.planners import make_planner
from dualnav_lite.rewards import TERMS

lesson_style()

# %% [markdown]
# ## 1. A rollout: fixed length, many worlds
#
# The article updates at `t % 512 == 0` inside a loop of 500 steps: only ever at `t = 0`. A rollout has a **fixed length**
# instead, over several worlds, and nothing waits for an episode to end. Here A\* drives six worlds for 400 steps, and in two more
# the robot sleeps.

# %%
WORLDS, STEPS = 8, 400


def rollout(worlds=WORLDS, steps=STEPS, seed=0):
    """Vector rewards (steps, n, 5), weights, and the two flags (steps, n) of a rollout."""
    env = DynamicNavVectorEnv(worlds, scenario="navigation")
    planner = make_planner("astar", Config())
    observations, infos = env.reset(seed=list(range(seed, seed + worlds)))
    planner.reset(np.arange(worlds))
    kept = {"rewards": [], "weights": [], "terminated": [], "truncated": []}
    for _ in range(steps):
        actions = planner.act(observations, split_infos(infos, worlds))
        actions[6:] = 0.0  # asleep
        observations, _, terminated, truncated, infos = env.step(actions)
        planner.reset(np.flatnonzero(terminated | truncated))
        step = (infos["vector_reward"], infos["reward_weights"], terminated, truncated)
        for name, value in zip(kept, step, strict=True):
            kept[name].append(value)
    return {name: np.stack(values) for name, values in kept.items()}


data = rollout()
ends = data["terminated"].sum(), data["truncated"].sum()
print(f"rewards {data['rewards'].shape}: {ends[0]} episodes terminated, {ends[1]} truncated")
figure, axis = plt.subplots(figsize=(9, 2.2))
reward = (data["rewards"] * data["weights"]).sum(axis=2)
axis.imshow(reward.T, aspect="auto", cmap="RdBu", vmin=-1, vmax=1, interpolation="none")
for flags, colour, mark in ((data["terminated"], RED, "|"), (data["truncated"], ORANGE, "x")):
    steps, worlds = np.nonzero(flags)
    axis.plot(steps, worlds, mark, color=colour, markersize=14, linestyle="")
axis.set(
    xlabel="step", ylabel="world", title="reward a step (blue: good); red bar: terminated, orange cross: truncated"
)
axis.grid(False)
plt.show()


# %% [markdown]
# An episode ends in one of two ways.
#
# - **terminated**: arrived, crashed, empty. There is no future, so its value is 0.
# - **truncated**: the clock ran out. The robot would have driven on; only our watching stopped. Its future is worth
#   $V$ of the *last observation*.
#
# ## 2. Generalised advantage estimation
#
# A critic guesses $V(s)$, what is still to come. One step surprises it by
#
# $$\delta_t = r_t + \gamma\,(1 - \text{terminated}_t)\,V(s'_t) - V(s_t)$$
#
# and the advantage adds up the surprises that follow, until the episode ends in either way:
#
# $$A_t = \delta_t + \gamma\lambda\,(1 - \text{ended}_t)\,A_{t+1}, \qquad R_t = A_t + V(s_t)$$
#
# $\lambda = 0$ trusts the critic alone, $\lambda = 1$ the rewards alone. $R_t$, the return, is what the critic learns next.
#
# **Exercise `gae`** (medium, very important, 15 minutes). All arrays are `(steps, n)`, the two flags are bools.
# `next_values[t]` is $V(s'_t)$: where an episode ended, the value of its own last observation. Beyond the last row $A$
# counts as 0. Give back advantages and returns.

# %% grade_id="gae" tags=["solution"]
def gae(rewards, values, next_values, terminated, truncated, gamma=0.99, gae_lambda=0.95):
    """Advantages and returns, (steps, n) each."""
    ### BEGIN SOLUTION
    deltas = rewards + gamma * np.where(terminated, 0.0, next_values) - values
    goes_on = ~(terminated | truncated)
    advantages, running = np.zeros_like(deltas), np.zeros(deltas.shape[1])
    for t in reversed(range(len(deltas))):
        running = deltas[t] + gamma * gae_lambda * goes_on[t] * running
        advantages[t] = running
    return advantages, advantages + values
    ### END SOLUTION


# %% grade_id="gae_check" points=5 tags=["check"]
check("gae", gae)


# %% [markdown]
# ## 3. The clock is not the end of the world
#
# A robot earns 1 at each step, for ever: $V = 1 / (1 - 0.99) = 100$. We watch it in pieces of 50 steps and let the
# critic, one number here, learn from its own returns.

# %%
def learned_value(is_end, rounds=400):
    """What a critic of one number believes after some rounds, if the time limit counts as an end, or as a cut."""
    last = np.zeros((50, 1), bool)
    last[-1] = True
    none, ones, value, history = np.zeros_like(last), np.ones((50, 1)), 0.0, []
    for _ in range(rounds):
        terminated, truncated = (last, none) if is_end else (none, last)
        _, returns = gae(ones, value * ones, value * ones, terminated, truncated)
        value += 0.5 * (returns.mean() - value)
        history.append(value)
    return history


as_cut, as_end = learned_value(False), learned_value(True)
figure, axis = plt.subplots(figsize=(7, 2.6))
axis.plot(as_cut, color=BLUE, label="truncated: bootstrapped")
axis.plot(as_end, color=RED, label="taken for terminated")
axis.axhline(100, color=GREY, linewidth=1, linestyle=":")
axis.set(xlabel="round", ylabel="learned V")
axis.legend()
plt.show()
print(f"learned value: {as_cut[-1]:.0f} with the cut, {as_end[-1]:.0f} with the clock as the end")
# expect: learned value: 100 with the cut, 27 with the clock as the end

# %% [markdown]
# The article's loop ignores its time limit altogether, and stores no values at all, so it could not have computed this.
#
# ## 4. How far to trust the critic
#
# Rewards are noise around 0, so the true advantage is 0 everywhere; the critic is wrong by 2 in each state. How large is
# the error of $A$ for each $\lambda$? On the left the critic's mistakes dominate, on the right the noise of many rewards.

# %%
def error_of(gae_lambda, worlds=200 if quick else 2000, steps=60):
    """Root mean square error of the first step's advantage."""
    rng = np.random.default_rng(1)
    rewards, wrong = rng.normal(size=(steps, worlds)), 2.0 * rng.normal(size=(steps + 1, worlds))
    none = np.zeros((steps, worlds), bool)
    advantages, _ = gae(rewards, wrong[:-1], wrong[1:], none, none, 0.99, gae_lambda)
    return float(np.sqrt(np.mean((advantages[0] + wrong[0]) ** 2)))  # the state's own error stays out: it shifts V


lambdas = np.linspace(0.0, 1.0, 21)
errors = [error_of(one) for one in lambdas]
figure, axis = plt.subplots(figsize=(7, 2.6))
axis.plot(lambdas, errors, marker="o", color=BLUE)
axis.set(xlabel="lambda", ylabel="error of the advantage")
plt.show()
print(f"least error at lambda {lambdas[int(np.argmin(errors))]:.2f}")

# %% [markdown]
# Where the least lies depends on how wrong the critic is. 0.95 is the usual compromise for long tasks.
#
# ## 5. Two claims of the article, settled by arithmetic
#
# *"PPO2: use `advantage = returns - values`; 42 % more stable."* But $R_t = A_t + V(s_t)$ **is** that sentence, read
# backwards. *"The critic must predict the total, or GAE fails."* Everything in `gae` is linear: the advantage of a
# weighted sum is the weighted sum of the advantages, so one value head a term works as well.

# %%
rng = np.random.default_rng(2)
terms, weights = data["rewards"], np.array([0.45, 0.25, 0.20, 0.10, 1.0])
values, next_values = rng.normal(size=terms.shape), rng.normal(size=terms.shape)
flags = data["terminated"], data["truncated"]
apart = [gae(terms[..., k], values[..., k], next_values[..., k], *flags)[0] for k in range(len(TERMS))]
together, returns = gae(terms @ weights, values @ weights, next_values @ weights, *flags)
difference = np.abs(sum(w * one for w, one in zip(weights, apart, strict=True)) - together).max()
definition = np.abs(returns - values @ weights - together).max()
print(f"largest difference {difference:.3f}; returns minus values {definition:.3f}")
# expect: largest difference 0.000; returns minus values 0.000

# %% [markdown]
# ## Change this one line and look
#
# - In `error_of`, the critic's `2.0`: with 0.2 and with 10, where does the least error go?
# - In `learned_value`, `50` in both places: with 500, how much does the wrong critic lose?
# - In `rollout`, let all robots sleep (`actions[0:] = 0.0`): how many episodes are terminated?
#
# Papers: Schulman et al., *High-dimensional continuous control using generalized advantage estimation*, 2016, eq. 16;
# Pardo et al., *Time limits in reinforcement learning*, 2018.
