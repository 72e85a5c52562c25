"""From probabilities of a grid of commands to one command: a vote over time, read between the points."""

import numpy as np


class CommandReader:
    """Commands from distributions over the grid: smoothed over time, then read between the points at the peak.

    Smoothing is a vote of the last steps: one noisy image cannot turn the robot around. The peak is chosen, never the
    mean of the whole, and its neighbours pull the command off the grid.

    Args:
        grid: (rows, columns, 2) v [m/s], omega [rad/s].
        memory: weight of the past in [0, 1); 0 reads each step alone.
    """

    def __init__(self, grid, memory: float = 0.5):
        self._grid = np.asarray(grid, float)
        self._memory = memory
        self._votes = np.zeros((0, *self._grid.shape[:2]))
        self._is_first = np.zeros(0, bool)

    def reset(self, indices) -> None:
        """Forget the past of these worlds."""
        indices = np.asarray(indices, int).reshape(-1)
        missing = int(indices.max(initial=-1)) + 1 - len(self._votes)
        if missing > 0:
            self._votes = np.concatenate([self._votes, np.zeros((missing, *self._votes.shape[1:]))])
            self._is_first = np.concatenate([self._is_first, np.ones(missing, bool)])
        self._is_first[indices] = True

    def __call__(self, probabilities, worlds=None):
        """Commands of some worlds; the others' votes stay as they are.

        Args:
            probabilities: (n, rows * columns).
            worlds: (n,) which they are about; 0 to n - 1 if None.

        Returns:
            (n, 2) float64 v [m/s], omega [rad/s].
        """
        worlds = np.arange(len(probabilities)) if worlds is None else np.asarray(worlds)
        known, needed = len(self._votes), int(worlds.max(initial=-1)) + 1
        if needed > known:
            self.reset(np.arange(known, needed))
        fresh = np.asarray(probabilities, float).reshape(len(worlds), *self._grid.shape[:2])
        share = np.where(self._is_first[worlds], 0.0, self._memory)[:, None, None]
        votes = share * self._votes[worlds] + (1.0 - share) * fresh
        self._votes[worlds], self._is_first[worlds] = votes, False
        return self._read(votes)

    def _read(self, votes):
        """The mean command of the 3 x 3 points around the highest vote, weighted by the votes."""
        n, rows, columns = votes.shape
        row, column = np.divmod(votes.reshape(n, -1).argmax(axis=1), columns)
        padded = np.zeros((n, rows + 2, columns + 2))
        padded[:, 1:-1, 1:-1] = votes
        step = np.arange(3)
        at_rows, at_columns = row[:, None, None] + step[:, None], column[:, None, None] + step
        near = padded[np.arange(n)[:, None, None], at_rows, at_columns]
        commands = self._grid[np.clip(at_rows - 1, 0, rows - 1), np.clip(at_columns - 1, 0, columns - 1)]
        return (near[..., None] * commands).sum(axis=(1, 2)) / near.sum(axis=(1, 2))[:, None]
