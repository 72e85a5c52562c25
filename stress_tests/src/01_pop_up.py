# %% [markdown]
# # Pop-up obstacle
#
# Up to three boxes slide into the robot's way, each 2 m ahead, at 1.5 m/s, from 0.7 to 1.0 m beside the path, and stay.
# They start when the odometer passes a drawn value, at any speed, so crawling does not help. The article claims 92 %.

# %% tags=["parameters"]
arms = ["astar", "cv_sampling"]
episodes = 5
seed_base = 2_000_000
jobs = 1
out = "results/01_pop_up"

# %% [markdown]
# ## What it looks like
#
# The arm is shown as it drives the first seed: robot, scan, people with their velocity, goal, guide point, trail.

# %%
from PIL import Image

from dualnav_lite.evaluate import evaluate
from dualnav_lite.stress import failures, picture
from dualnav_lite.survival import survival

scenarios = ["pop_up"]

for scenario in scenarios:
    display(Image.fromarray(picture(arms[0], scenario, seed_base, until_s=8.0)))

# %% [markdown]
# ## Who survives
#
# Survived means: goal reached in time, no contact, charge left. The interval is Wilson's, 95 %: with few episodes it is
# wide. The article's are rates of 100 runs: 92 of 100 means 85 to 96 %.

# %%
rows = evaluate(arms, scenarios, range(seed_base, seed_base + episodes), out, jobs=jobs)
table = survival(rows)
rates = ["survival_rate", "wilson_low", "wilson_high", "article_claim"]
table[["scenario", "arm", "episodes", "survived", *rates]].round(3)

# %% [markdown]
# Safety beside energy, the two objectives: least clearance of the hull and energy, means over runs.

# %%
table[["scenario", "arm", "mean_min_clearance_m", "mean_energy_j", "energy_j_per_m"]].round(2)

# %% [markdown]
# ## Where failures come from

# %%
rows.groupby(["scenario", "arm", "outcome"]).size().unstack(fill_value=0)

# %%
failed = failures(rows)
failed

# %% [markdown]
# The end of the first failed run: the trail shows how the robot came there.

# %%
for run in failed.head(1).itertuples():
    display(Image.fromarray(picture(run.arm, run.scenario, run.seed)))

# %% [markdown]
# ## Change this one line and look
#
# Set `scenarios = ["pop_up", "pop_up_head_on"]` in the second code cell. Head-on at 1.5 m/s, a robot with 0.8 m/s
# cannot get away: of 40 tuning seeds even `ceiling`, which sees the truth, survives none. What the article means by
# "pops up 2 m ahead at 1.5 m/s" decides everything.
