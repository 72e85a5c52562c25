# hint: project on the direction
import numpy as np


def flow_component(flow, component):
    if component == "x":
        image = -flow[..., 1]
    elif component == "speed":
        image = np.sqrt(flow[..., 0] ** 2 + flow[..., 1] ** 2)
    else:
        image = -flow[..., 0]
    return np.clip(image / 1.5, -1.0, 1.0)
