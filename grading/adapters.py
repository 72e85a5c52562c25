"""Plain arrays to a student's arguments and back, inside the sandbox; one adapter an exercise.

An adapter gets (names of the notebook, arrays of the call, what is kept between calls) and gives arrays.
"""

import numpy as np


def _numbers(value) -> np.ndarray:
    """float64 of whatever came back; an object that only pretends to be a number raises here or is converted."""
    return np.array(value, dtype=np.float64, subok=False)


def _each(function, *columns) -> np.ndarray:
    """A function called with plain Python numbers, row by row."""
    return np.array([float(function(*(value.item() for value in row))) for row in zip(*columns, strict=True)])


def safe(names, given, kept):
    function = names["safe"]
    if "one_by_one" in given:
        return {"values": _each(function, given["one_by_one"])}
    return {"values": _numbers(function(given["clearance"].copy()))}


def goal(names, given, kept):
    function, gamma = names["goal"], given["gamma"].item()
    before, after, reached = (given[name].copy() for name in ("before", "after", "reached"))
    if "one_by_one" in given:
        return {"values": _each(lambda b, a, r: function(b, a, r, gamma), before, after, reached)}
    return {"values": _numbers(function(before, after, reached, gamma))}


def reward_terms(names, given, kept):
    from dualnav_lite.rewards import Transition

    rows = []
    for k in range(len(given["clearance"])):
        fields = {name: value[k].item() if value[k].ndim == 0 else value[k].copy() for name, value in given.items()}
        terms = names["reward_terms"](Transition(**fields))
        rows.append([float(terms[name]) for name in ("safe", "dynamic", "energy", "goal", "terminal")])
        if len(terms) != 5:
            raise KeyError("terms")
    return {"values": np.array(rows)}


def reward_weights(names, given, kept):
    rows = [
        names["reward_weights"](p.item(), b.item()) for p, b in zip(given["preference"], given["charge"], strict=True)
    ]
    return {"values": _numbers(np.stack([_numbers(row) for row in rows]))}


def gae(names, given, kept):
    arrays = [given[name].copy() for name in ("rewards", "values", "next_values", "terminated", "truncated")]
    advantages, returns = names["gae"](*arrays, given["gamma"].item(), given["gae_lambda"].item())
    return {"advantages": _numbers(advantages), "returns": _numbers(returns)}


def _tensor(value):
    import torch

    return torch.from_numpy(value.copy())


def _loss(loss, inputs) -> dict:
    """A loss and its gradients."""
    import torch

    gradients = torch.autograd.grad(loss, list(inputs.values()), allow_unused=True)
    found = {"loss": _numbers(loss.detach().numpy())}
    for (name, value), gradient in zip(inputs.items(), gradients, strict=True):
        found[f"gradient_{name}"] = _numbers(np.zeros(value.shape) if gradient is None else gradient.numpy())
    return found


def policy_loss(names, given, kept):
    log_probs = _tensor(given["log_probs"]).requires_grad_()
    loss = names["policy_loss"](
        log_probs, _tensor(given["old_log_probs"]), _tensor(given["advantages"]), given["clip_range"].item()
    )
    return _loss(loss, {"log_probs": log_probs})


def value_loss(names, given, kept):
    values = _tensor(given["values"]).requires_grad_()
    return _loss(names["value_loss"](values, _tensor(given["returns"])), {"values": values})


def policy(names, given, kept):
    """Commands of an exported policy for (n, C, 64, 64) observations; `fresh` worlds begin anew."""
    if "driver" not in kept:
        import tempfile

        from dualnav_lite.deploy import EmbeddedPolicy

        with open(names["weights"], "rb") as file, tempfile.NamedTemporaryFile(suffix=".onnx") as copy:
            copy.write(file.read())
            copy.flush()
            kept["driver"] = EmbeddedPolicy(copy.name)
    driver = kept["driver"]
    if given["fresh"].any():
        driver.reset(np.flatnonzero(given["fresh"]))
    return {"actions": _numbers(driver.act(given["observations"]))}


ADAPTERS = {
    "safe": safe,
    "goal": goal,
    "reward_terms": reward_terms,
    "reward_weights": reward_weights,
    "gae": gae,
    "policy_loss": policy_loss,
    "value_loss": value_loss,
    "policy": policy,
}
