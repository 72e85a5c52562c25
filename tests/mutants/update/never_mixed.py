# hint: put the samples into a new order
import torch


def update(actor, critic, optimizers, batch, settings, rng):
    for _ in range(settings.epochs):
        for rows in torch.arange(len(batch.log_probs)).split(settings.minibatch):
            gains = batch.advantages[rows]
            gains = (gains - gains.mean()) / (gains.std(unbiased=False) + 1e-8)
            log_probs, entropies = actor.head.judge(actor(batch.observations[rows]), batch.actions[rows])
            change = log_probs - batch.log_probs[rows]
            kl = (torch.expm1(change) - change).mean().item()
            bounded = torch.clamp(change.exp(), 1 - settings.clip_range, 1 + settings.clip_range)
            loss = -torch.minimum(change.exp() * gains, bounded * gains).mean()
            errors = 0.5 * ((critic(batch.observations[rows]) - batch.returns[rows]) ** 2).sum(dim=1).mean()
            numbers = {"policy_loss": loss.item(), "value_loss": errors.item(), "approx_kl": kl}
            numbers["entropy"] = entropies.mean().item()
            if kl > 1.5 * settings.target_kl:
                return numbers
            explored = loss - settings.entropy_coef * entropies.mean()
            jobs = [(actor, optimizers[0], explored), (critic, optimizers[1], errors)]
            for network, optimizer, wanted in jobs:
                optimizer.zero_grad()
                wanted.backward()
                torch.nn.utils.clip_grad_norm_(network.parameters(), settings.max_gradient_norm)
                optimizer.step()
    return numbers
