"""A trained policy: an exported network, or weights in the library's own one."""

from .arrays import numbers


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
        return {"actions": numbers(run(given["observations"].copy()))}
    reader.reset(given["worlds"][given["fresh"]])
    return {"actions": numbers(reader(run(given["observations"].copy()), given["worlds"]))}
