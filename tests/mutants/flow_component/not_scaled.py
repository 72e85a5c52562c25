# hint: 1.5 m/s reads 1
import numpy as np


def flow_component(flow, component):
    middles = 31.5 - np.arange(64)
    ahead, left = np.meshgrid(middles, middles, indexing="ij")
    if component == "x":
        image = -flow[..., 1]
    elif component == "speed":
        image = np.sqrt(flow[..., 0] ** 2 + flow[..., 1] ** 2)
    else:
        image = -(flow[..., 0] * ahead + flow[..., 1] * left) / np.hypot(ahead, left)
    return np.clip(image, -1.0, 1.0)
