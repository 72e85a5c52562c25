"""The exercises of lessons 09 and 10: advantages, losses with their gradients, updates, and learning by them."""

import numpy as np

from .arrays import numbers, tensor, theirs


def gae(names, given, kept):
    arrays = [given[name].copy() for name in ("rewards", "values", "next_values", "terminated", "truncated")]
    advantages, returns = theirs(names, "gae")(*arrays, given["gamma"].item(), given["gae_lambda"].item())
    return {"advantages": numbers(advantages), "returns": numbers(returns)}


def _loss(loss, inputs) -> dict:
    """A loss and its gradients."""
    import torch

    gradients = torch.autograd.grad(loss, list(inputs.values()), allow_unused=True)
    found = {"loss": numbers(loss.detach().numpy())}
    for (name, value), gradient in zip(inputs.items(), gradients, strict=True):
        found[f"gradient_{name}"] = numbers(np.zeros(value.shape) if gradient is None else gradient.numpy())
    return found


def policy_loss(names, given, kept):
    log_probs = tensor(given["log_probs"]).requires_grad_()
    loss = theirs(names, "policy_loss")(
        log_probs, tensor(given["old_log_probs"]), tensor(given["advantages"]), given["clip_range"].item()
    )
    return _loss(loss, {"log_probs": log_probs})


def value_loss(names, given, kept):
    values = tensor(given["values"]).requires_grad_()
    return _loss(theirs(names, "value_loss")(values, tensor(given["returns"])), {"values": values})


class _Dealt:
    """In place of a random generator: it deals samples onto so many piles, so that minibatches are known."""

    def __init__(self, piles):
        self.piles = piles

    def permutation(self, samples):
        samples = np.arange(samples) if np.ndim(samples) == 0 else np.array(samples)
        return np.concatenate([samples[pile :: self.piles] for pile in range(self.piles)])

    def shuffle(self, samples):
        samples[:] = self.permutation(samples)


def update(names, given, kept):
    import torch
    from torch import nn

    from dualnav_lite.ppo import PPO, Batch

    class Head:
        def judge(self, logits, actions):
            log_p = torch.log_softmax(logits, dim=1)
            return log_p.gather(1, actions[:, None])[:, 0], -(log_p.exp() * log_p).sum(dim=1)

    def linear(name):
        weights, bias = tensor(given[f"{name}_weights"]), tensor(given[f"{name}_bias"])
        layer = nn.Linear(weights.shape[1], weights.shape[0], dtype=weights.dtype)
        with torch.no_grad():
            layer.weight.copy_(weights)
            layer.bias.copy_(bias)
        return layer

    actor, critic = linear("actor"), linear("critic")
    actor.head = Head()
    optimizers = torch.optim.SGD(actor.parameters(), lr=0.3), torch.optim.SGD(critic.parameters(), lr=0.1)
    seen, returns = tensor(given["observations"]), tensor(given["returns"])
    kept_samples = [tensor(given[name]) for name in ("actions", "log_probs", "advantages")]
    batch = Batch(seen, *kept_samples, returns, critic(seen).detach())
    whole = {name: int(given[name].item()) for name in ("epochs", "minibatch")}
    rates = ("clip_range", "entropy_coef", "max_gradient_norm", "target_kl")
    settings = PPO(**whole, **{name: given[name].item() for name in rates}, threads=1)
    told = theirs(names, "update")(actor, critic, optimizers, batch, settings, _Dealt(int(given["piles"].item())))

    def parameters(layer):
        return np.column_stack([layer.weight.detach().numpy(), layer.bias.detach().numpy()])

    found = {"actor": parameters(actor)}
    if given["epochs"] <= 4:
        found |= {"critic": parameters(critic), "advantages": batch.advantages.numpy()}
    if given["tells"]:
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
    seen = tensor(given["observations"])
    if "advantages" not in given:
        with torch.no_grad():
            actions, log_probs = actor.head.sample(actor(seen), kept["draws"])
            return {"actions": actions.numpy(), "log_probs": log_probs.numpy(), "values": critic(seen).numpy()}
    samples = [tensor(given[name]) for name in ("actions", "log_probs", "advantages", "returns", "values")]
    theirs(names, "update")(actor, critic, kept["optimizers"], Batch(seen, *samples), kept["settings"], kept["rng"])
    return {}
