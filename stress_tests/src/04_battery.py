# %% [markdown]
# # Three hours on one battery
#
# One world, three hours, a goal every 20 s, no time lapse. A contact costs 30 s and the robot is put back. It
# survives with at least 520 goals, at least 15 % of charge left and at most 12 contacts. The article claims 100 %. A
# run takes one to four minutes, so this notebook has a count of its own.

# %% tags=["parameters"]
arms = ["astar"]
episodes = 1
seed_base = 2_000_000
jobs = 1
out = "results/04_battery"

# %% [markdown]
# ## What it looks like
#
# The arm is shown as it drives the first seed: robot, scan, people with their velocity, goal, guide point, trail.

# %%
from PIL import Image

from dualnav_lite.evaluate import evaluate
from dualnav_lite.stress import failures, picture
from dualnav_lite.survival import survival

scenarios = ["battery"]

for scenario in scenarios:
    display(Image.fromarray(picture(arms[0], scenario, seed_base, until_s=20.0)))

# %% [markdown]
# ## Who survives
#
# Standing still fails on goals, full speed fails on energy: there is a best speed.

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
# ## Change this one line and look
#
# Pass `overrides={"hardware.max_lin_vel": 0.5}` to `evaluate`, with another `out`: slower, and yet as many goals?
