"""Plain arrays to a student's arguments and back, inside the sandbox; one adapter an exercise.

An adapter gets (names of the notebook, arrays of the call, what is kept between calls) and gives arrays.
"""

import numpy as np


class NotDefined(Exception):
    """The notebook defines no such name: its cell raised, or names its function otherwise."""


def _theirs(names, word: str):
    """The student's function."""
    if word not in names:
        raise NotDefined
    return names[word]


def _numbers(value) -> np.ndarray:
    """float64 of whatever came back; an object that only pretends to be a number raises here or is converted."""
    return np.array(value, dtype=np.float64, subok=False)


def _each(function, *columns) -> np.ndarray:
    """A function called with plain Python numbers, row by row."""
    return np.array([float(function(*(value.item() for value in row))) for row in zip(*columns, strict=True)])


def safe(names, given, kept):
    function = _theirs(names, "safe")
    if "one_by_one" in given:
        return {"values": _each(function, given["one_by_one"])}
    return {"values": _numbers(function(given["clearance"].copy()))}


def goal(names, given, kept):
    function, gamma = _theirs(names, "goal"), given["gamma"].item()
    before, after, reached = (given[name].copy() for name in ("before", "after", "reached"))
    if "one_by_one" in given:
        return {"values": _each(lambda b, a, r: function(b, a, r, gamma), before, after, reached)}
    return {"values": _numbers(function(before, after, reached, gamma))}


def reward_terms(names, given, kept):
    from dualnav_lite.rewards import Transition

    rows = []
    for k in range(len(given["clearance"])):
        fields = {name: value[k].item() if value[k].ndim == 0 else value[k].copy() for name, value in given.items()}
        terms = _theirs(names, "reward_terms")(Transition(**fields))
        rows.append([float(terms[name]) for name in ("safe", "dynamic", "energy", "goal", "terminal")])
        if len(terms) != 5:
            raise KeyError("terms")
    return {"values": np.array(rows)}


def reward_weights(names, given, kept):
    rows = [
        _theirs(names, "reward_weights")(p.item(), b.item())
        for p, b in zip(given["preference"], given["charge"], strict=True)
    ]
    return {"values": _numbers(np.stack([_numbers(row) for row in rows]))}


def gae(names, given, kept):
    arrays = [given[name].copy() for name in ("rewards", "values", "next_values", "terminated", "truncated")]
    advantages, returns = _theirs(names, "gae")(*arrays, given["gamma"].item(), given["gae_lambda"].item())
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
    loss = _theirs(names, "policy_loss")(
        log_probs, _tensor(given["old_log_probs"]), _tensor(given["advantages"]), given["clip_range"].item()
    )
    return _loss(loss, {"log_probs": log_probs})


def value_loss(names, given, kept):
    values = _tensor(given["values"]).requires_grad_()
    return _loss(_theirs(names, "value_loss")(values, _tensor(given["returns"])), {"values": values})


def _driver(path: str):
    """Who answers observations: an exported network, or weights in the library's own one."""
    with open(path, "rb") as file:
        content = file.read()
    if not content.startswith(b"PK"):  # an archive of torch.save
        from dualnav_lite.command_reader import CommandReader
        from dualnav_lite.embedded import onnx_runner

        run, card = onnx_runner(content)
        return run, CommandReader(card["grid"], card["memory"]) if card["grid"] else None
    return _driver_of_weights(content)


def _driver_of_weights(content: bytes):
    """The same from a state dict; what its card would say follows from the shapes, the memory is the default."""
    import io

    import torch

    from dualnav_lite.command_reader import CommandReader
    from dualnav_lite.config import Hardware
    from dualnav_lite.policy import make_actor

    state = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    first = state["trunk.convolutions.0.weight"]
    grain = "fine" if first.shape[-1] == 5 else "coarse"
    head = "commands" if "head.commands" in state else "gaussian"
    limits = [Hardware().max_lin_vel, Hardware().max_ang_vel]
    actor = make_actor((first.shape[1] + 1, 64, 64), head, limits, grain)
    actor.load_state_dict(state)
    actor.eval()
    torch.set_num_threads(1)

    def run(observations):
        with torch.no_grad():
            output = actor(torch.from_numpy(observations))
            if head == "commands":
                return output.exp().numpy()
            return actor.head.physical(output.chunk(2, dim=1)[0]).numpy()

    if head == "gaussian":
        return run, None
    grid = actor.head.commands.reshape(*actor.head.grid_shape, 2).double().numpy()
    return run, CommandReader(grid.round(6), 0.5)


def policy(names, given, kept):
    """Commands for (n, C, 64, 64) observations of some worlds; those that are `fresh` begin anew."""
    if "driver" not in kept:
        kept["driver"] = _driver(names["weights"])
    run, reader = kept["driver"]
    if reader is None:
        return {"actions": _numbers(run(given["observations"].copy()))}
    reader.reset(given["worlds"][given["fresh"]])
    return {"actions": _numbers(reader(run(given["observations"].copy()), given["worlds"]))}


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
