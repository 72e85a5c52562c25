"""What a step was worth: five named terms, their weights, in three forms.

`repaired` is the default; `article` is the article's section 2.3 as its code would run; `article_fixed` adds the
article's own repairs (4.1 z-score window, 4.2 squared hinge) and applies the weights of its table. PPO never
differentiates a reward, so nothing here has to be differentiable, whatever the article's title of 2.3 says.
"""

from dataclasses import dataclass

import numpy as np

from dualnav_lite.config import Robot
from dualnav_lite.kernels import intrusion
from dualnav_lite.motion import STEP_S

TERMS = ("safe", "dynamic", "energy", "goal", "terminal")

SAFE_DISTANCE_M = 0.3  # article 4.2
SAFE_SCALE = 10.0  # article 4.2: -0.9 a step at contact
DYNAMIC_SCALE = 1.0  # r_dynamic lies in [-1, 0]
INTRUSION_MARGIN_M = 0.3  # gap to a mover's future at which the penalty starts; below it people feel crowded
# A step at full speed costs 0.04. Small, because a robot that parks pays the idle power for ever: at weight 1.36 (all
# thrift, 20 % charge) a journey of 8 m still has to be worth more than that (a test checks it).
ENERGY_SCALE = 0.04
# [1/m]. With weight 0.10 a metre of progress is worth 1, a journey about as much as the arrival. Linear, since the
# article's exp(-d/5) vanishes where the gradient is needed: 0.08 a metre at 10 m against 0.6 at the goal.
GOAL_SCALE = 10.0
REACHED, FAILED = 10.0, -10.0  # arrival; contact or flat battery

ARTICLE_WINDOW = 100  # article 4.1
HULL_RADIUS_M = Robot().hull_radius_m


@dataclass
class Transition:
    """What one control step did; every field is a scalar or an array with the same leading axes.

    Attributes:
        clearance: from the hull to the nearest solid after the step, truth [m]; negative counts as 0.
        min_range: smallest range of the scan [m]; only the article's forms read it.
        action: (..., 2) executed v [m/s], omega [rad/s].
        mover_velocity, predicted_velocity: (..., 2) of the nearest mover, as it was and as the predictor said [m/s];
            equal where there is none. Only the article's forms read them.
        intrusion: `predicted_intrusion` after the step, in [0, 1].
        energy_j, reference_j: drawn in this step; drawn by a step at full speed on the straight.
        path_before, path_after: way to the goal along free space [m], truth.
        goal_distance: as the crow flies, after the step [m]; only the article's forms read it.
        reached, collided, flat_battery: bool; how the step ended the run, if it did.
    """

    clearance: np.ndarray
    min_range: np.ndarray
    action: np.ndarray
    mover_velocity: np.ndarray
    predicted_velocity: np.ndarray
    intrusion: np.ndarray
    energy_j: np.ndarray
    reference_j: np.ndarray
    path_before: np.ndarray
    path_after: np.ndarray
    goal_distance: np.ndarray
    reached: np.ndarray
    collided: np.ndarray
    flat_battery: np.ndarray


def linear_potential(path_length):
    """Phi of the default: every metre of path is worth the same, however far the goal."""
    return -GOAL_SCALE * np.asarray(path_length, float)


def article_potential(distance):
    """3 exp(-d / 5), the article's r_goal; as a reward a step it pays for loitering, as a potential it is harmless."""
    return 3.0 * np.exp(-np.asarray(distance, float) / 5.0)


def shaping(before, after, reached, gamma, potential=linear_potential):
    """gamma * Phi(s') - Phi(s): pays for progress.

    With the trainer's gamma the discounted sum over a run telescopes to gamma^T Phi(s_T) - Phi(s_0), which no behaviour
    on the way can change: the best policy stays the best. But a robot that stands earns (1 - gamma) |Phi| a step, as
    much as one that drives, so nothing leads a beginner to the goal. With gamma 1, the environment's default, a metre
    is worth the same whenever it is driven, and standing still nothing.

    Phi is 0 at arrival. After a failure it keeps its value, so a failure costs the way that was left as well; the
    optimal policy is that of a reward with this terminal in place of a constant one.

    Args:
        before, after: (...,) way to the goal [m].
        reached: (...,) bool.
        gamma: discount of the trainer, or 1.
        potential: function of the way.

    Returns:
        (...,) shaping reward.

    Source: Ng, Harada, Russell, "Policy invariance under reward transformations", ICML 1999; Grzes, "Reward shaping in
    episodic reinforcement learning", AAMAS 2017, for the last state.
    """
    return gamma * np.where(reached, 0.0, potential(after)) - potential(before)


def hinge(distance):
    """-10 (0.3 - d)^2 below 0.3 m, else 0 (article 4.2)."""
    missing = np.minimum(np.maximum(SAFE_DISTANCE_M - np.asarray(distance, float), 0.0), SAFE_DISTANCE_M)
    return -SAFE_SCALE * missing * missing


def _repaired(t, gamma):
    failed = np.logical_or(t.collided, t.flat_battery)
    return {
        "safe": hinge(t.clearance),
        "dynamic": -DYNAMIC_SCALE * np.asarray(t.intrusion, float),
        "energy": -ENERGY_SCALE * np.asarray(t.energy_j, float) / t.reference_j,
        "goal": shaping(t.path_before, t.path_after, t.reached, gamma),
        "terminal": np.where(failed, FAILED, np.where(t.reached, REACHED, 0.0)),
    }


def _article(t):
    action = np.asarray(t.action, float)
    error = np.linalg.norm(np.asarray(t.mover_velocity, float) - t.predicted_velocity, axis=-1)
    distance = np.asarray(t.min_range, float)
    return {
        "safe": -distance * 10.0,  # the article's sign: more room costs more
        "dynamic": -error * 5.0,
        "energy": -(np.abs(action[..., 0]) + 0.5 * np.abs(action[..., 1])) * 2.0,
        "goal": article_potential(t.goal_distance),
        "terminal": np.zeros_like(distance),
    }


def reward_terms(t, rewards):
    """The five terms of a transition, before any weight.

    The article's 4.1 window is not applied here but by `WindowScore`, since it remembers.

    Args:
        t: `Transition`, one world or many.
        rewards: `config.Rewards`.

    Returns:
        dict in the order of `TERMS`, each of the shape of `t.clearance`. In the repaired form safe lies in [-0.9, 0],
        dynamic in [-1, 0], energy is at most 0, terminal is one of -10, 0, 10.
    """
    if rewards.form == "repaired":
        return _repaired(t, rewards.gamma)
    terms = _article(t)
    if rewards.form == "article_fixed":
        terms["safe"] = hinge(t.min_range)
    return terms


def reward_weights(preference, charge, rewards):
    """Weights of the five terms.

    Repaired: w_safe = 2 (1 - p) w_safe, w_energy = 2 p (1 + 3 (1 - charge)) w_energy, the rest as configured: p = 0.5
    at full charge gives the configured weights. `article`: ones, because its code sums the dictionary.
    `article_fixed`: the configured weights, whatever the preference.

    Args:
        preference: (...,) p in [0, 1]: 0 all safety, 1 all thrift.
        charge: (...,) in [0, 1].
        rewards: `config.Rewards`.

    Returns:
        (..., 5) in the order of `TERMS`.
    """
    preference, charge = np.asarray(preference, float), np.asarray(charge, float)
    weights = np.empty((*preference.shape, len(TERMS)))
    if rewards.form == "article":
        weights[...] = 1.0
        return weights
    weights[...] = [getattr(rewards, term) for term in TERMS]
    if rewards.form == "repaired":
        weights[..., 0] *= 2.0 * (1.0 - preference)
        weights[..., 2] *= 2.0 * preference * (1.0 + 3.0 * (1.0 - charge))
    return weights


def vector_reward(terms):
    """(..., 5) the terms as one array, in the order of `TERMS`; the reward is its dot product with the weights."""
    vector = np.empty((*np.shape(terms[TERMS[0]]), len(TERMS)))
    for k, name in enumerate(TERMS):
        vector[..., k] = terms[name]
    return vector


def predicted_intrusion(twists, prediction, hull_radius=HULL_RADIUS_M):
    """How far a robot that keeps its twist will drive into where movers will be, within the prediction's horizon.

    Args:
        twists: (n, 2) v [m/s], omega [rad/s].
        prediction: batched `motion.Prediction`.
        hull_radius: of the robot [m].

    Returns:
        (n,) in [0, 1]: 1 for touching hulls one step ahead, 0 where every gap stays above `INTRUSION_MARGIN_M`.
    """
    out = np.empty(len(twists))
    intrusion.predicted_intrusion(
        np.asarray(twists, float),
        prediction.positions,
        prediction.radii,
        prediction.valid,
        hull_radius,
        INTRUSION_MARGIN_M,
        STEP_S,
        out,
    )
    return out


def matched_velocities(prediction, mover_positions, mover_velocities, mover_valid, reach=1.0):
    """Velocity of the nearest predicted mover, as it is and as predicted, for the article's r_dynamic.

    Args:
        prediction: batched `motion.Prediction` over k movers.
        mover_positions, mover_velocities: (n, c, 2) truth, robot frame [m], [m/s].
        mover_valid: (n, c) bool.
        reach: a predicted mover farther than this from every true one has no match [m].

    Returns:
        (n, 2) true and (n, 2) predicted velocity; both zero where nothing is predicted or matched.
    """
    worlds = np.arange(len(mover_positions))
    here = prediction.positions[:, :, 0]
    distances = np.where(prediction.valid, np.linalg.norm(here, axis=-1), np.inf)
    nearest = distances.argmin(axis=1)
    gaps = np.linalg.norm(mover_positions - here[worlds, nearest][:, None], axis=-1)
    gaps = np.where(mover_valid, gaps, np.inf)
    match = gaps.argmin(axis=1)
    is_matched = prediction.valid[worlds, nearest] & (gaps[worlds, match] <= reach)
    keep = is_matched[:, None]
    predicted = np.where(keep, prediction.velocities[worlds, nearest], 0.0)
    return np.where(keep, mover_velocities[worlds, match], 0.0), predicted


class WindowScore:
    """The article's 4.1: each term minus its mean over the last 100 steps, by their standard deviation, a world each.

    It takes the mean away, so always safe and always unsafe both score 0, and a rare collision is silenced; kept to be
    watched failing. The repaired form is scaled by the trainer, by a running standard deviation with the mean kept.
    """

    def __init__(self, num_envs: int):
        self._values = np.zeros((num_envs, ARTICLE_WINDOW, len(TERMS)))
        self._count = np.zeros(num_envs, np.int64)

    def reset(self, indices) -> None:
        """Forget the windows of these worlds, so that a run depends on its own steps alone."""
        self._count[indices] = 0

    def __call__(self, terms, active=None):
        """Scored copy of a terms dictionary of (n,) arrays; `terminal` passes through. Inactive worlds score 0."""
        values = vector_reward(terms)
        active = np.ones(len(values), bool) if active is None else active
        worlds = np.flatnonzero(active)
        self._values[worlds, self._count[worlds] % ARTICLE_WINDOW] = values[worlds]
        self._count[worlds] += 1
        filled = np.arange(ARTICLE_WINDOW) < self._count[:, None]
        share = filled / np.maximum(filled.sum(axis=1, keepdims=True), 1)
        mean = np.einsum("nw,nwt->nt", share, self._values)
        spread = np.sqrt(np.einsum("nw,nwt->nt", share, (self._values - mean[:, None]) ** 2))
        scored = np.where(active[:, None], (values - mean) / (spread + 1e-6), 0.0)
        return {name: terms[name] if name == "terminal" else scored[:, k] for k, name in enumerate(TERMS)}
