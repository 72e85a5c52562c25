"""The exercises of lesson 06: images from a robot's own state, a scan and forecasts."""

from .arrays import numbers, theirs


def _ego(given, **more):
    from dualnav_lite.encoder import Ego

    names = ("twist", "battery", "goal_robot", "guide_robot", "map_age_s", "preference")
    values = {name: given[name].item() if given[name].ndim == 0 else given[name].copy() for name in names}
    return Ego(**values, **more)


def paint_bands(names, given, kept):
    return {"image": numbers(theirs(names, "paint_bands")(_ego(given)))}


def project_intensity(names, given, kept):
    return {"image": numbers(theirs(names, "project_intensity")(given["scan"].copy()))}


def encode_state(names, given, kept):
    from dualnav_lite.motion import Prediction

    forecast = Prediction(*(given[name].copy() for name in ("positions", "velocities", "valid", "radii")))
    arrays = (given[name].copy() for name in ("scans", "poses", "map_crop"))
    image = numbers(theirs(names, "encode_state")(*arrays, _ego(given, forecast=forecast)))
    channels = ("static", "motion", "ego", "intensity")
    return dict(zip(channels, image if image.shape == (4, 64, 64) else [image] * 4, strict=True))
