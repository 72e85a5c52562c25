# hint: an index from the other end
import numpy as np


def cache(image, pose_sent, pose_now):
    centre = 0.1 * (31.5 - np.arange(64))
    ahead, left = np.meshgrid(centre, centre, indexing="ij")
    c, s = np.cos(pose_now[2]), np.sin(pose_now[2])
    x = pose_now[0] + c * ahead - s * left - pose_sent[0]
    y = pose_now[1] + s * ahead + c * left - pose_sent[1]
    c, s = np.cos(pose_sent[2]), np.sin(pose_sent[2])
    x, y = c * x + s * y, c * y - s * x
    row, column = np.floor(32 - x / 0.1).astype(int), np.floor(32 - y / 0.1).astype(int)
    return image[row % 64, column % 64]
