# %% [markdown]
# # A stress case
#
# `python kit.py stress` runs this notebook once for each case of `stress_tests/cases.yaml`. Opened by hand it runs the
# case named below, with five seeds. Nothing is worked out here: rows come from `evaluate`, tables from rows.

# %% tags=["parameters"]
case = "pop_up"
arms = ["ppo", "ppo_filter"]
episodes = 5
seed_base = 2_000_000
jobs = 1
shard = "1/1"
cluster = ""
preference = 0.5
overrides = {}
out = "results/pop_up"

# %%
from IPython.display import Markdown, display
from PIL import Image

from dualnav_lite import stress
from dualnav_lite.chunks import arm_name
from dualnav_lite.episodes import cell_text
from dualnav_lite.judge import with_published
from dualnav_lite.report import survival_lines
from dualnav_lite.survival import failures
from dualnav_lite.traces import picture

display(Markdown(stress.load_case(case).about))

# %% [markdown]
# ## What it looks like
#
# The first arm as it drives the first seed: robot, scan, people with their velocity, goal, guide point, trail.

# %%
for scenario in stress.load_case(case).scenarios:
    display(Image.fromarray(picture(arms[0], scenario, seed_base, until_s=8.0)))

# %% [markdown]
# ## Who survives
#
# Survived means: goal reached in time, no contact, charge left; for three hours see above. The interval is Wilson's,
# 95 %: with few episodes it is wide. The article's rates are of 100 runs: 92 of 100 means 85 to 96 %.

# %%
rows = stress.run_case(case, arms, episodes, seed_base, out, jobs, shard, cluster, preference, overrides)
display(Markdown("\n".join(survival_lines(with_published(rows)))))

# %% [markdown]
# The last two columns are the two objectives: least clearance of the hull and energy, means over runs. Floor, best blind
# arm and ceiling are the published rows of the same seeds, where there are any.

# %% [markdown]
# ## Where failures come from

# %%
rows.groupby(["scenario", "arm", "outcome"]).size().unstack(fill_value=0)

# %%
failed = failures(rows)
failed

# %% [markdown]
# The end of the first failed short run: the trail shows how the robot came there.

# %%
drivers = {cell_text("arm", arm_name(one)): one for one in arms}  # the arm behind a row's name
for run in failed[failed.time_s < 600].head(1).itertuples():
    display(Image.fromarray(picture(drivers[run.arm], run.scenario, run.seed)))

# %% [markdown]
# ## Change this one line and look

# %%
display(Markdown(stress.load_case(case).change))
