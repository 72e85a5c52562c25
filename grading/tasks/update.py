"""`update`: the parameters that a linear policy and linear values have afterwards, gradients worked out by hand.

The generator that is handed over deals the samples onto piles, as a rule one: in order. So minibatches are the same for
everybody; where there are more, one epoch is asked for, since `permutation` and `shuffle` part ways in the second.
"""

import numpy as np

from grading.tasks import Question

FEATURES, TERMS, RATES = 4, 2, (0.3, 0.1)


def _clipped(gradients: list[np.ndarray], most: float) -> list[np.ndarray]:
    norm = np.sqrt(sum(float(np.sum(one**2)) for one in gradients))
    return [one * min(1.0, most / (norm + 1e-6)) for one in gradients]


def _policy_step(weights, bias, batch, rows, rule, ddof):
    """Parameters after one step; policy loss, entropy and approximate KL before it."""
    seen, taken = batch["observations"][rows], batch["actions"][rows]
    logits = seen @ weights.T + bias
    log_p = logits - np.log(np.exp(logits - logits.max(1, keepdims=True)).sum(1, keepdims=True))
    log_p -= logits.max(1, keepdims=True)
    p, picked = np.exp(log_p), np.eye(2)[taken]
    change = (log_p * picked).sum(1) - batch["log_probs"][rows]
    ratio, gain = np.exp(change), batch["advantages"][rows]
    gain = (gain - gain.mean()) / (gain.std(ddof=ddof) + 1e-8)
    clipped = np.clip(ratio, 1.0 - rule["clip_range"], 1.0 + rule["clip_range"])
    entropy = -(p * log_p).sum(1)
    told = [-np.mean(np.minimum(ratio * gain, clipped * gain)), entropy.mean(), np.mean(ratio - 1.0 - change)]
    free = ratio * gain <= clipped * gain
    slope = (-ratio * gain * free)[:, None] * (picked - p)
    slope += rule["entropy_coef"] * p * (log_p + entropy[:, None])
    gradients = _clipped([slope.T @ seen / len(rows), slope.mean(0)], rule["max_gradient_norm"])
    return weights - RATES[0] * gradients[0], bias - RATES[0] * gradients[1], told


def _value_step(weights, bias, batch, rows, rule):
    seen = batch["observations"][rows]
    errors = seen @ weights.T + bias - batch["returns"][rows]
    loss = 0.5 * np.mean((errors**2).sum(1))
    gradients = _clipped([errors.T @ seen / len(rows), errors.mean(0)], rule["max_gradient_norm"])
    return weights - RATES[1] * gradients[0], bias - RATES[1] * gradients[1], loss


def _right(batch, rule, policy_steps=10**9, ddof=0):
    """Everything that is compared, after at most so many steps of the policy.

    `ddof` 1 is the deviation of a sample, by n - 1, which torch's `std` gives unasked; it is as right as 0.
    """
    actor, critic = (batch["actor_weights"], batch["actor_bias"]), (batch["critic_weights"], batch["critic_bias"])
    steps, told, loss = 0, [0.0] * 3, 0.0
    order = np.concatenate([np.arange(len(batch["actions"]))[pile :: rule["piles"]] for pile in range(rule["piles"])])
    for _ in range(int(rule["epochs"])):
        for rows in np.split(order, len(order) // int(rule["minibatch"])):
            if steps < policy_steps:
                *actor, told = _policy_step(*actor, batch, rows, rule, ddof)
                steps += 1
            *critic, loss = _value_step(*critic, batch, rows, rule)
    found = {"actor": np.column_stack(actor), "critic": np.column_stack(critic), "advantages": batch["advantages"]}
    return found, np.array([told[0], loss, told[1], told[2]])


def _a_batch(rng: np.random.Generator, samples: int) -> dict[str, np.ndarray]:
    seen = rng.normal(size=(samples, FEATURES))
    weights, bias = 0.3 * rng.normal(size=(2, FEATURES)), 0.1 * rng.normal(size=2)
    logits = seen @ weights.T + bias
    log_p = logits - np.log(np.exp(logits).sum(1, keepdims=True))
    actions = (rng.random(samples) < 0.5).astype(np.int64)
    return {
        "actor_weights": weights,
        "actor_bias": bias,
        "critic_weights": 0.3 * rng.normal(size=(TERMS, FEATURES)),
        "critic_bias": 0.1 * rng.normal(size=TERMS),
        "observations": seen,
        "actions": actions,
        "log_probs": log_p[np.arange(samples), actions],
        "advantages": 3.0 * rng.normal(size=samples) + 2.0,
        "returns": rng.normal(size=(samples, TERMS)) + 1.0,
    }


def questions(rng: np.random.Generator) -> list[Question]:
    """One step; several epochs; minibatches; short gradients; the brake; the batch as it was in all of them."""
    also = {
        "critic": "values_learn_as_well",
        "advantages": "batch_stays_as_it_was",
        "numbers": "numbers_of_the_last_step",
    }

    def ask(hint, share, samples=24, tells=False, **changes):
        batch = _a_batch(rng, samples)
        if tells:  # the policy that drove was another one: every way to measure the distance to itself gives 0
            batch["log_probs"] += 0.15 * rng.normal(size=samples)
        rule = {"epochs": 1, "minibatch": samples, "clip_range": 0.2, "entropy_coef": 0.0, "max_gradient_norm": 1e3}
        rule |= {"target_kl": 1e3, "piles": 1, "tells": tells} | changes
        (right, numbers), (too, numbers_too) = (_right(batch, rule, ddof=ddof) for ddof in (0, 1))
        other = {"actor": [too["actor"]], "numbers": [numbers_too]}
        arrays = batch | {name: np.array(float(value)) for name, value in rule.items()}
        return Question(hint, arrays, right | ({"numbers": numbers} if tells else {}), share, 1e-5, also, other)

    def brake(share):
        """Each epoch is one minibatch, and the first step goes too far: no second one, or one before it shows."""
        batch = _a_batch(rng, 24)
        rule = {"epochs": 12, "minibatch": 24, "clip_range": 0.2, "entropy_coef": 0.0, "max_gradient_norm": 1e3}
        rule |= {"target_kl": 1e-7, "piles": 1, "tells": False}
        right, *others = (_right(batch, rule, steps, ddof)[0]["actor"] for steps in (1, 2) for ddof in (0, 1))
        arrays = batch | {name: np.array(float(value)) for name, value in rule.items()}
        return Question("brake_where_it_moved_too_far", arrays, {"actor": right}, share, 1e-5, other={"actor": others})

    return [
        ask("one_step_down_the_loss", 0.2, clip_range=0.5, tells=True),
        ask("entropy_is_worth_something", 0.1, entropy_coef=0.5),
        ask("several_epochs", 0.2, epochs=4, clip_range=0.1),
        ask("minibatches_one_after_the_other", 0.1, samples=36, minibatch=12, epochs=2),
        ask("samples_in_a_new_order", 0.1, samples=36, minibatch=12, piles=5),
        ask("gradients_are_cut", 0.15, max_gradient_norm=0.02),
        brake(0.15),
    ]
