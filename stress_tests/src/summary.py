# %% [markdown]
# # Stress test: verdicts
#
# Made from rows alone: the `episodes.csv` of each case, and the published rows of the other arms in
# `stress_tests/reference/`, joined by seed. Opened by hand it shows what the last `python kit.py stress` left.

# %% tags=["parameters"]
results = "results"
language = "en"

# %%
from IPython.display import Image, Markdown, display

from dualnav_lite.figures.results import make_result_figures
from dualnav_lite.judge import judge_folder
from dualnav_lite.report import PAIRED_HEADER, markdown, paired_cells, survival_lines

tables = judge_folder(results)

# %% [markdown]
# ## Who survives
#
# Beside each rate: its interval, what the article claims for its own policy (a claim, not a rival measured here), the
# floor (a robot that stands still), the best arm that drives blind, and the ceiling that sees the truth.

# %%
display(Markdown("\n".join(survival_lines(tables["survival"]))))

# %% [markdown]
# ## On the same seeds
#
# `only a` and `only b` count the seeds on which just one of the two survived; p is McNemar's, exact.

# %%
display(Markdown("\n".join(markdown(PAIRED_HEADER, paired_cells(tables["paired"])))))

# %% [markdown]
# ## Safety against energy, run by run
#
# The article's view: share of runs that no other run of the same scenario and arm dominates. With independent points it
# falls as runs are added, so it says little; the front of preferences is the one to look at.

# %%
points = tables["pareto_episodes"]
points.groupby(["scenario", "arm"], sort=False).pareto_optimal.agg(share="mean", runs="size").round(3)

# %% [markdown]
# ## Figures

# %%
for path in make_result_figures(results, language=language, formats=("png", "svg", "pdf")):
    if path.suffix == ".png":
        display(Image(filename=str(path), width=760))

# %% [markdown]
# ## Change this one line and look
#
# Set `language = "zh"` in the parameters: the same figures with Chinese labels, if a Chinese font is installed.
