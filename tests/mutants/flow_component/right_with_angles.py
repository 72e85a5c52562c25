# right
import numpy as np


def flow_component(flow, component):
    speed, course = np.hypot(flow[..., 0], flow[..., 1]), np.arctan2(flow[..., 1], flow[..., 0])
    row, column = np.mgrid[0:64, 0:64]
    bearing = np.arctan2(31.5 - column, 31.5 - row)
    image = {"x": -speed * np.sin(course), "speed": speed, "radial": -speed * np.cos(course - bearing)}[component]
    return np.minimum(np.maximum(image / 1.5, -1.0), 1.0)
