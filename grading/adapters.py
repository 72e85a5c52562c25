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


def _ego(given, **more):
    from dualnav_lite.encoder import Ego

    names = ("twist", "battery", "goal_robot", "guide_robot", "map_age_s", "preference")
    values = {name: given[name].item() if given[name].ndim == 0 else given[name].copy() for name in names}
    return Ego(**values, **more)


def paint_bands(names, given, kept):
    return {"image": _numbers(_theirs(names, "paint_bands")(_ego(given)))}


def project_intensity(names, given, kept):
    return {"image": _numbers(_theirs(names, "project_intensity")(given["scan"].copy()))}


def encode_state(names, given, kept):
    from dualnav_lite.motion import Prediction

    forecast = Prediction(*(given[name].copy() for name in ("positions", "velocities", "valid", "radii")))
    arrays = (given[name].copy() for name in ("scans", "poses", "map_crop"))
    image = _numbers(_theirs(names, "encode_state")(*arrays, _ego(given, forecast=forecast)))
    channels = ("static", "motion", "ego", "intensity")
    return dict(zip(channels, image if image.shape == (4, 64, 64) else [image] * 4, strict=True))


class _Script:
    """An environment that is written down beforehand; after its end nothing more happens."""

    def __init__(self, given):
        self.given, self.steps, self.actions, self.seed = given, 0, [], -1.0

    def _state(self):
        k = min(self.steps, len(self.given["rewards"]))
        return self.given["observations"][k].copy(), {"number": self.given["numbers"][k].item()}

    def reset(self, *, seed=None, options=None):
        self.seed, self.steps, self.actions = float(-1 if seed is None else seed), 0, []
        return self._state()

    def step(self, action):
        length = len(self.given["rewards"])
        if self.steps < length:
            self.actions.append(float(action))
        reward = self.given["rewards"][self.steps].item() if self.steps < length else 0.0
        self.steps += 1
        observation, info = self._state()
        is_last, is_terminated = self.steps == length, bool(self.given["is_terminated"])
        if self.steps > length:
            return observation, reward, True, True, info  # a loop that went on past the end comes to one
        return observation, reward, is_last and is_terminated, is_last and not is_terminated, info


def closed_loop(names, given, kept):
    env = _Script(given)

    def choose(observation, info):
        return float(observation @ given["gain"]) + info["number"]

    told = _theirs(names, "closed_loop")(env, choose, given["seed"].item())
    actions = np.zeros(len(given["rewards"]))
    actions[: len(env.actions)] = env.actions
    ends = {"terminated": 1.0, "truncated": 0.0}
    return {
        "seed": _numbers(env.seed),
        "actions": actions,
        "steps": _numbers(told["steps"]),
        "reward": _numbers(told["reward"]),
        "is_terminated": _numbers(ends[told["ended"]]),
    }


class _InOrder:
    """In place of a random generator: what it mixes stays in order, so that minibatches are the same for everybody."""

    def permutation(self, samples):
        return np.arange(samples) if np.ndim(samples) == 0 else np.array(samples)

    def shuffle(self, samples):
        pass


def update(names, given, kept):
    import torch
    from torch import nn

    from dualnav_lite.ppo import PPO, Batch

    class Head:
        def judge(self, logits, actions):
            log_p = torch.log_softmax(logits, dim=1)
            return log_p.gather(1, actions[:, None])[:, 0], -(log_p.exp() * log_p).sum(dim=1)

    def linear(name):
        weights, bias = _tensor(given[f"{name}_weights"]), _tensor(given[f"{name}_bias"])
        layer = nn.Linear(weights.shape[1], weights.shape[0], dtype=weights.dtype)
        with torch.no_grad():
            layer.weight.copy_(weights)
            layer.bias.copy_(bias)
        return layer

    actor, critic = linear("actor"), linear("critic")
    actor.head = Head()
    optimizers = torch.optim.SGD(actor.parameters(), lr=0.3), torch.optim.SGD(critic.parameters(), lr=0.1)
    seen, returns = _tensor(given["observations"]), _tensor(given["returns"])
    kept_samples = [_tensor(given[name]) for name in ("actions", "log_probs", "advantages")]
    batch = Batch(seen, *kept_samples, returns, critic(seen).detach())
    whole = {name: int(given[name].item()) for name in ("epochs", "minibatch")}
    rates = ("clip_range", "entropy_coef", "max_gradient_norm", "target_kl")
    settings = PPO(**whole, **{name: given[name].item() for name in rates}, threads=1)
    told = _theirs(names, "update")(actor, critic, optimizers, batch, settings, _InOrder())

    def parameters(layer):
        return np.column_stack([layer.weight.detach().numpy(), layer.bias.detach().numpy()])

    found = {"actor": parameters(actor)}
    if given["epochs"] <= 4:
        found |= {"critic": parameters(critic), "advantages": batch.advantages.numpy()}
    if given["epochs"] == 1 and given["entropy_coef"] == 0.0 and given["max_gradient_norm"] > 1.0:
        wanted = ("policy_loss", "value_loss", "entropy", "approx_kl")
        found["numbers"] = np.array([float(told[name]) for name in wanted])
    return found


def learning(names, given, kept):
    """A student's PPO among the library's networks: begin anew, `select_action`, or `update` with a batch."""
    import torch

    from dualnav_lite.policy import Critic, make_actor
    from dualnav_lite.ppo import PPO, Batch, make_optimizers
    from dualnav_lite.trunks import trunk_for

    if "seed" in given:
        torch.set_num_threads(1)
        torch.manual_seed(given["seed"].item())
        whole = {name: int(given[name].item()) for name in ("epochs", "minibatch")}
        rates = ("learning_rate_actor", "learning_rate_critic", "clip_range", "entropy_coef", "target_kl")
        settings = PPO(**whole, **{name: given[name].item() for name in rates}, threads=1)
        actor, critic = make_actor((1,), "gaussian", [1.0]), Critic(trunk_for((1,)), 1)
        kept["networks"], kept["settings"] = (actor, critic), settings
        kept["optimizers"] = make_optimizers(actor, critic, settings)
        kept["draws"] = torch.Generator().manual_seed(given["seed"].item())
        kept["rng"] = np.random.default_rng(given["seed"].item())
        return {}
    actor, critic = kept["networks"]
    seen = _tensor(given["observations"])
    if "advantages" not in given:
        with torch.no_grad():
            actions, log_probs = actor.head.sample(actor(seen), kept["draws"])
            return {"actions": actions.numpy(), "log_probs": log_probs.numpy(), "values": critic(seen).numpy()}
    samples = [_tensor(given[name]) for name in ("actions", "log_probs", "advantages", "returns", "values")]
    _theirs(names, "update")(actor, critic, kept["optimizers"], Batch(seen, *samples), kept["settings"], kept["rng"])
    return {}


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
    from dualnav_lite.trunks import GRAINS

    state = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    first = state["trunk.convolutions.0.weight"]
    grain = next(name for name, grain in GRAINS.items() if grain.convolutions[0][1] == first.shape[-1])
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
    "paint_bands": paint_bands,
    "project_intensity": project_intensity,
    "encode_state": encode_state,
    "closed_loop": closed_loop,
    "policy_loss": policy_loss,
    "value_loss": value_loss,
    "update": update,
    "learning": learning,
    "policy": policy,
}
