# right
import numpy as np


def cache(image, pose_sent, pose_now):
    ahead, left = np.mgrid[0:64, 0:64] * -0.1 + 3.15
    here = complex(*pose_now[:2]) + (ahead + 1j * left) * np.exp(1j * pose_now[2])
    there = (here - complex(*pose_sent[:2])) * np.exp(-1j * pose_sent[2])
    padded = np.pad(image, 1, constant_values=1 / 6)
    row, column = np.rint(31.5 - there.real / 0.1), np.rint(31.5 - there.imag / 0.1)
    return padded[np.clip(row + 1, 0, 65).astype(int), np.clip(column + 1, 0, 65).astype(int)]
