"""`learning`: a student's update in a loop that the scorer owns, until it has learned a hidden problem or has not.

A point on a line is pushed left or right and pays for its distance from a place that nobody tells it, nor which way a
push goes: only rewards say. Plain arrays go in and out: `select_action` is a draw from the policy with its
log-probability and value, `update` a batch. World, advantages, returns and the judgement stand here.
"""

import numpy as np

from dualnav_lite.rollout import gae_reference
from grading.tasks import Ask, Marks

NEEDED, MARGIN = 0.7, 0.1  # told to students: a right update comes to 0.9, one that does not learn stays below 0.1
WORLDS, STEPS = 16, 25
JOURNEYS, UPDATES = 2, 15  # journeys of every world before each update
LAST = 2  # rounds of journeys whose mean share says what was learned
TRIALS = 3  # where the first lies within the margin, the mean of three decides
STRIDE, GAMMA, GAE_LAMBDA = 0.2, 0.95, 0.95
SETTINGS = {
    "epochs": 6.0,
    "minibatch": 200.0,
    "learning_rate_actor": 1e-2,
    "learning_rate_critic": 2e-2,
    "clip_range": 0.2,
    "entropy_coef": 0.0,
    "target_kl": 0.05,
}
LOOK = {"actions": (WORLDS, 1), "log_probs": (WORLDS,), "values": (WORLDS, 1)}  # what `select_action` answers


class Useless(Exception):
    """An answer that cannot be used; its text is a reason code."""


class Line:
    """Points on a line, all let go at once; gone after `STEPS` steps.

    Args:
        rng: of the hidden goal, the hidden direction and the places where journeys begin.
    """

    def __init__(self, rng: np.random.Generator):
        self._rng = rng
        self._goal = rng.uniform(0.5, 1.5) * rng.choice([-1.0, 1.0])
        self._push = STRIDE * rng.choice([-1.0, 1.0])

    def reset(self) -> np.ndarray:
        """(worlds,) places from which new journeys begin."""
        self._x = self._rng.uniform(-2.0, 2.0, WORLDS)
        return self._x

    def step(self, actions) -> tuple[np.ndarray, np.ndarray]:
        """(worlds,) places and rewards after (worlds,) pushes, each cut to [-1, 1]."""
        self._x = np.clip(self._x + self._push * np.clip(actions, -1.0, 1.0), -3.0, 3.0)
        return self._x, -np.abs(self._x - self._goal)

    def bounds(self, starts) -> tuple[float, float]:
        """Summed reward of journeys from (worlds,) places if nothing moves, and if each goes straight to the goal."""
        way = np.abs(starts - self._goal)
        left = np.maximum(0.0, way - STRIDE * np.arange(1, STEPS + 1)[:, None])
        return -STEPS * float(way.sum()), -float(left.sum())


def _answered(ask: Ask, arrays: dict, shapes: dict[str, tuple[int, ...]]) -> dict[str, np.ndarray]:
    """Finite numbers of these shapes; `Useless` else."""
    raised, answer = ask(arrays)
    if raised:
        raise Useless(raised)
    if set(answer) != set(shapes):
        raise Useless("wrong_type")
    for name, shape in shapes.items():
        if answer[name].dtype.kind != "f":
            raise Useless("wrong_type")
        if answer[name].shape != shape:
            raise Useless("wrong_shape")
        if not np.isfinite(answer[name]).all():
            raise Useless("not_finite")
    return answer


def journeys(line: Line, ask: Ask) -> tuple[dict[str, np.ndarray], float]:
    """One journey in each world: (STEPS x WORLDS, ...) samples, and the share gained of what standing still leaves."""
    places, kept = line.reset(), []
    idle, straight = line.bounds(places)
    for _ in range(STEPS):
        seen = {"observations": places[:, None].astype(np.float32)}
        look = _answered(ask, seen, LOOK)
        places, rewards = line.step(look["actions"][:, 0].astype(float))
        kept.append(seen | look | {"rewards": rewards})
    last = _answered(ask, {"observations": places[:, None].astype(np.float32)}, LOOK)["values"]
    steps = {name: np.stack([one[name] for one in kept]) for name in kept[0]}
    values = np.concatenate([steps["values"], last[None]])[..., 0].astype(float)
    rewards = steps.pop("rewards")
    truncated = np.zeros(rewards.shape, bool)
    truncated[-1] = True  # the clock ends it, and no failure: the last value counts
    nothing = np.zeros_like(truncated)
    advantages, returns = gae_reference(rewards, values[:-1], values[1:], nothing, truncated, GAMMA, GAE_LAMBDA)
    steps |= {"advantages": advantages.astype(np.float32), "returns": returns[..., None].astype(np.float32)}
    samples = {name: value.reshape(-1, *value.shape[2:]) for name, value in steps.items()}
    return samples, (float(rewards.sum()) - idle) / (straight - idle)


def trial(rng: np.random.Generator, ask: Ask) -> tuple[float, float]:
    """Share that was gained in the first round of journeys, and in the last ones."""
    line, shares = Line(rng), []
    begin = SETTINGS | {"seed": rng.integers(1 << 30)}
    _answered(ask, {name: np.array(value) for name, value in begin.items()}, {})
    for _ in range(UPDATES):
        parts, gained = zip(*(journeys(line, ask) for _ in range(JOURNEYS)), strict=True)
        shares.append(float(np.mean(gained)))
        _answered(ask, {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}, {})
    return shares[0], float(np.mean(shares[-LAST:]))


def play(rng: np.random.Generator, ask: Ask, marks: Marks) -> None:
    """One trial; where it is too close to tell, two more, and their mean."""
    found: list[tuple[float, float]] = []
    try:
        while not found or (len(found) < TRIALS and abs(found[0][1] - NEEDED) < MARGIN):
            found.append(trial(rng, ask))
    except Useless as problem:
        marks.reason = str(problem)
        return
    first, last = np.mean(found, axis=0)
    marks.detail["learning"] = {
        "first": round(float(first), 3),
        "last": round(float(last), 3),
        "needed": NEEDED,
        "aim": round(NEEDED + MARGIN, 3),
    }
    marks.passed = bool(last >= NEEDED)
    marks.share = float(marks.passed)
    marks.reason = "" if marks.passed else "does_not_learn"
