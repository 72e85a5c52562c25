# %% [markdown]
# # Crowd crossing
#
# Five people, less than 0.5 m apart, walk across the robot's way at 0.8 m/s. They start when the robot is close
# enough to be met, so waiting at the start does not help. `crowd_crossing` ignores the robot, `crowd_reactive` makes
# room for it. The article claims 76 % and does not say whether its people react.

# %% tags=["parameters"]
arms = ["astar", "cv_sampling"]
episodes = 5
seed_base = 2_000_000
jobs = 1
out = "results/02_crowd_crossing"

# %% [markdown]
# ## What it looks like
#
# The arm is shown as it drives the first seed: robot, scan, people with their velocity, goal, guide point, trail.

# %%
from PIL import Image

from dualnav_lite.evaluate import evaluate
from dualnav_lite.stress import failures, picture
from dualnav_lite.survival import survival

scenarios = ["crowd_crossing", "crowd_reactive"]

for scenario in scenarios:
    display(Image.fromarray(picture(arms[0], scenario, seed_base, until_s=9.0)))

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
# Set `arms = ["astar", "cv_sampling", "orca"]` (orca needs `requirements-bench.txt`): which of them loses most between
# people who react and people who do not, and why?
