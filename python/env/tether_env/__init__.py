"""Tether's closed loop as an environment that learning programs step, by Gymnasium's contract.

    import tether_env

    env = tether_env.Env("scenarios/paper.toml", {"channel.prr": 0.5}, action="twist")
    observation, info = env.reset(seed=1)
    observation, reward, terminated, truncated, info = env.step([1.0, 0.2])

docs/howto/learning.md says more.
"""

from ._core import ResetNeeded, UsageError
from .environments import Env, VectorEnv
from .spaces import Box

__all__ = ["Box", "Env", "ResetNeeded", "UsageError", "VectorEnv"]
