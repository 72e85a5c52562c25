# %% [markdown]
# # 14 Deploy: from a network to a robot
#
# **Aim**: export a policy in two formats, prove that they say the same, and measure how long a command takes and how soon
# the robot answers to what pops up.
#
# **Time**: 30 minutes for you, 12 s of CPU. **Number to expect**: the two exports differ by less than **0.00001**,
# and each file is smaller than 8 MB.
#
# The policy here is *untrained* unless you have one of your own from lesson 11. Formats and latency do not care; it drives
# accordingly. (Part 4 then asks the policy that comes with the kit.)

# %% tags=["parameters"]
quick = False  # the tests run this notebook with fewer repetitions

# %% tags=["given"]
import numpy as np

from dualnav_lite.check import check

# %%
import time
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
import torch

from dualnav_lite.config import Config
from dualnav_lite.deploy import EmbeddedPolicy, card_of, export
from dualnav_lite.encoder import encode_state as library_encoder
from dualnav_lite.figures.lesson import BLUE, GREEN, ORANGE, RED, drive, lesson_style
from dualnav_lite.measures.latency import TICK_COLUMNS, first_answer
from dualnav_lite.parts import part
from dualnav_lite.policy import make_actor

torch.set_num_threads(1)
lesson_style()
encode_state = part("encode_state")

# %% [markdown]
# ## 1. Export
#
# `.pth` holds weights alone, and needs the Python class around it. `.pt` (TorchScript) and `.onnx` hold the computation as
# well: no Python class, no training code. The article saves `.pth` and then loads `.pt`.
#
# A *card* travels inside the files: which channels the policy was trained with, which guide. A policy that is fed another
# channel than it knows falls apart without a word; the card turns that into an error.

# %%
config = Config()
weights = Path("weights")
if (weights / "ppo_actor.onnx").exists():
    print("your policy of lesson 11")
    paths = {ending: weights / f"ppo_actor.{ending}" for ending in ("pth", "pt", "onnx")}
else:
    print("an untrained policy")
    torch.manual_seed(0)
    actor = make_actor((4, 64, 64), "commands", [config.hardware.max_lin_vel, config.hardware.max_ang_vel])
    paths = export(actor, card_of(actor, config, memory=0.5), weights, "untrained")
print(", ".join(f"{ending} {path.stat().st_size / 1e6:.2f} MB" for ending, path in paths.items()))
policies = {ending: EmbeddedPolicy(paths[ending], config) for ending in ("pt", "onnx")}
policies["onnx"].card["observation"]

# %% [markdown]
# ## 2. Do they say the same?
#
# On images that the robot really sees, not on random ones.

# %%
states = []


def kept(scans, poses, map_crop, ego):
    """Your encoder, which keeps what it saw."""
    states.append((scans, poses, map_crop, ego, encode_state(scans, poses, map_crop, ego)))
    return states[-1][-1]


def driver(policy):
    """A chooser for `drive` that asks an exported policy."""
    policy.reset(np.arange(1))
    return lambda observation, info: policy.get_action(observation[None])


run = drive(driver(policies["onnx"]), "crowd_crossing", seed=3, steps=20 if quick else 120, encoder=kept)
images = np.stack([state[-1] for state in states])
outputs = {ending: policy.output(images) for ending, policy in policies.items()}
gap = float(np.abs(outputs["pt"] - outputs["onnx"]).max())
print(f"{len(images)} images, largest difference {gap:.5f}")
# expect: images, largest difference 0.00000

# %% [markdown]
# ## 3. How long does a command take?
#
# A mean hides what matters on a robot: the rare slow step. So read the 99th percentile (p99). The article adds *means* of
# stages to 142 ms, and counts into it the 71 ms that the wheels need to settle, which is no computing at all.

# %%
def seconds_of(call, repeats):
    """Time of each call [s], after a warm-up."""
    for _ in range(3):
        call(0)
    found = []
    for k in range(repeats):
        begin = time.perf_counter()
        call(k)
        found.append(time.perf_counter() - begin)
    return np.array(found)


REPEATS = 60 if quick else 600
stages = {
    "your encoder": lambda k: encode_state(*states[k % len(states)][:4]),
    "library's encoder": lambda k: library_encoder(*states[k % len(states)][:4]),
    "TorchScript": lambda k: policies["pt"].output(images[k % len(images)][None]),
    "ONNX Runtime": lambda k: policies["onnx"].output(images[k % len(images)][None]),
}
milliseconds = {name: 1000.0 * seconds_of(call, REPEATS) for name, call in stages.items()}
latency = pd.DataFrame({name: np.percentile(one, [50, 95, 99]) for name, one in milliseconds.items()}).T
latency.columns = ["p50 [ms]", "p95 [ms]", "p99 [ms]"]
latency.round(3)

# %%
figure, axis = plt.subplots(figsize=(8, 2.6))
place = np.arange(len(latency))
for k, (name, colour) in enumerate(zip(latency.columns, (BLUE, GREEN, ORANGE), strict=True)):
    axis.barh(place + 0.25 * (k - 1), latency[name], 0.25, color=colour, label=name)
axis.set_yticks(place, latency.index)
axis.set(xscale="log", xlim=(0.005, 100), xlabel="time for one command [ms]; the right edge is a control step, 100 ms")
axis.set_xticks([0.01, 0.1, 1, 10, 100], ["0.01", "0.1", "1", "10", "100"])
axis.legend(loc="center right")
plt.show()


# %% [markdown]
# On a laptop this is far below the 100 ms of a control step. What the robot's own computer needs must be measured there.
#
# ## 4. How soon does it answer? Ask its twin
#
# Computing fast is not reacting soon. The article allows 200 ms from the thing in the lidar's view to another command. But
# commands change all the time: which change was the answer?
#
# A clean question: a box pops up; which is the *first command that would have been another one without it*? So drive the
# same episode twice, side by side, with the box and without. From the first scan that shows the box, count ticks of 0.1 s
# until the commands differ by more than 0.05 m/s or 0.1 rad/s.
#
# **Exercise `ticks_to_answer`** (easy, 10 minutes). Two arrays of commands v [m/s], omega [rad/s], (steps, 2): the drive with
# the box and its twin without. `seen` is the row whose scan shows the box first, and the command of that very row is
# tick 1. One of the two numbers is enough to differ. No command differs from there on? `float("nan")`.

# %% grade_id="ticks_to_answer" tags=["solution"]
def ticks_to_answer(driven, twin, seen):
    """Control steps from the first scan of the box to the first command that it changed."""
    ### BEGIN SOLUTION
    gap = np.abs(driven - twin)[seen:]
    differs = (gap[:, 0] > 0.05) | (gap[:, 1] > 0.1)
    return float(np.argmax(differs) + 1) if differs.any() else float("nan")
    ### END SOLUTION


# %% grade_id="ticks_to_answer_check" points=2 tags=["check"]
check("ticks_to_answer", ticks_to_answer)

# %% [markdown]
# `first_answer` of the library counts the same way, while both drive:

# %%
asked = str(paths["onnx"]) if paths["onnx"].stem == "ppo_actor" else "ppo"
seeds = range(1_000_000, 1_000_000 + (3 if quick else 20))  # tuning seeds
answers = pd.DataFrame([first_answer(asked, seed) for seed in seeds], columns=TICK_COLUMNS)
seen = answers[answers.seen_s.notna()]
ticks = seen.ticks.dropna()
print(f"{len(seen)} boxes seen, {len(ticks)} answered", end="")
print(f", half of them within {1000 * 0.1 * ticks.median():.0f} ms" if len(ticks) else "")
figure, axis = plt.subplots(figsize=(7, 2.4))
axis.hist(100 * ticks.clip(upper=10), bins=np.arange(50, 1150, 100), color=BLUE)
axis.axvline(200, color=RED, linestyle=":", label="article")
axis.set(xlabel="from the first scan of the box to another command [ms]", ylabel="episodes")
axis.set_xticks(range(100, 1100, 100), [*range(100, 1000, 100), "1000+"])
axis.legend()
plt.show()

# %% [markdown]
# 100 ms is the least there is: the very command that follows that scan. A late answer need not be a bad one: a box that
# stays out of the way asks for none.
#
# ## 5. Wrong input must not drive
#
# A robot that acts on nonsense is worse than one that stops.

# %%
for text, wrong in (("three channels", images[:1, :3]), ("no batch axis", images[0])):
    try:
        policies["onnx"].output(wrong)
    except ValueError as error:
        print(f"{text}: {error}")

# %% [markdown]
# ## Change this one line and look
#
# - `images[k % len(images)][None]` in part 3: `images[:16]`, sixteen at once. What does one cost then?
# - `torch.set_num_threads(1)`: with 2, is a single command faster?
# - `memory=training.memory` in part 5 of lesson 11: with 0 each image is read alone. Run that cell again while its
#   notebook is open, then this lesson. Does the robot tremble?
#
# Source: the article's 3.3 and 5.2; `dualnav_lite/deploy.py`.
