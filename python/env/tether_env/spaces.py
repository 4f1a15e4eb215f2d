"""Boxes of numbers: Gymnasium's if it is there, else these, which do as much of the same."""

import numpy as np

try:
    from gymnasium.spaces import Box
    from gymnasium.vector.utils import batch_space
except ImportError:

    class Box:
        """Arrays of `shape` and `dtype` between `low` and `high`, both included."""

        def __init__(self, low, high, shape=None, dtype=np.float64, seed=None):
            shape = np.shape(low) if shape is None else tuple(shape)
            self.dtype = np.dtype(dtype)
            self.low = np.full(shape, low, self.dtype)
            self.high = np.full(shape, high, self.dtype)
            self.shape = shape
            self.seed(seed)

        def seed(self, seed=None):
            self._random = np.random.default_rng(seed)

        def sample(self):
            """Uniform within bounds; where there is none, exponential from the other, or normal."""
            low, high = np.isfinite(self.low), np.isfinite(self.high)
            drawn = self._random.normal(size=self.shape)
            tail = self._random.exponential(size=self.shape)
            drawn = np.where(low & ~high, np.where(low, self.low, 0) + tail, drawn)
            drawn = np.where(high & ~low, np.where(high, self.high, 0) - tail, drawn)
            both = low & high
            within = self._random.uniform(np.where(both, self.low, 0), np.where(both, self.high, 1))
            return np.where(both, within, drawn).astype(self.dtype)

        def contains(self, x):
            return bool(
                isinstance(x, np.ndarray) and x.shape == self.shape and np.can_cast(x.dtype, self.dtype)
                and np.all(x >= self.low) and np.all(x <= self.high)
            )

        __contains__ = contains

        def __repr__(self):
            return f"Box({self.low.min()}, {self.high.max()}, {self.shape}, {self.dtype})"

    def batch_space(space, n):
        return Box(np.stack([space.low] * n), np.stack([space.high] * n), dtype=space.dtype)


__all__ = ["Box", "batch_space"]
