# %% [markdown]
# # Comms dropout
#
# The map comes from a computer off the robot, 1 s late, and 30 % of its messages never arrive: each by itself in
# `comms_dropout`, in bursts of 1 s on average in `comms_dropout_bursts`. Everything that needs the map suffers: the
# static channel, the guide point, and planners on the map. The article claims 68 %.

# %% tags=["parameters"]
arms = ["astar", "cv_sampling"]
episodes = 5
seed_base = 2_000_000
jobs = 1
out = "results/05_comms_dropout"

# %% [markdown]
# ## What it looks like
#
# The arm is shown as it drives the first seed: robot, scan, people with their velocity, goal, guide point, trail.

# %%
from PIL import Image

from dualnav_lite.evaluate import evaluate
from dualnav_lite.stress import failures, picture
from dualnav_lite.survival import survival

scenarios = ["comms_dropout", "comms_dropout_bursts"]

for scenario in scenarios:
    display(Image.fromarray(picture(arms[0], scenario, seed_base, until_s=6.0)))

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
# Pass `overrides={"map.cache": False}` to `evaluate`, with another `out`: without the cache the last map is not moved
# along with the robot. This is the article's "historical map cache", asked for there and never shown.
