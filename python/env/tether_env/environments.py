"""One closed loop, and n of them that are stepped at once."""

import json
import os

import numpy as np

from . import _core
from .spaces import Box, batch_space

try:
    import gymnasium

    _Env, _VectorEnv = gymnasium.Env, gymnasium.vector.VectorEnv
    _NEXT_STEP, _DISABLED = gymnasium.vector.AutoresetMode.NEXT_STEP, gymnasium.vector.AutoresetMode.DISABLED
except (ImportError, AttributeError):
    _Env = _VectorEnv = object
    _NEXT_STEP, _DISABLED = "NextStep", "Disabled"

_OPTIONS = ("settings", "log")


def _as_text(value):
    """A scenario's value in TOML's notation, which for these types is JSON's."""
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, np.ndarray):
        value = value.tolist()
    return json.dumps(value.item() if isinstance(value, np.generic) else value)


def _overrides(settings):
    if not isinstance(settings, dict):
        raise TypeError(f"settings: {type(settings).__name__} is not allowed; a dict of scenario keys is")
    return [f"{key}={_as_text(value)}" for key, value in settings.items()]


def _numbers(action, shape):
    action = np.asarray(action)
    if action.dtype.kind not in "fiu":
        raise TypeError(f"action: dtype {action.dtype} is not allowed; float64, or what becomes it: floats and integers")
    if action.shape != shape:
        raise ValueError(f"action: shape {action.shape} is not allowed; allowed: {shape}")
    return np.ascontiguousarray(action, np.float64)


def _seed(seed):
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)):
        raise TypeError(f"seed: {seed!r} is not allowed; a whole number is, or None")
    if not 0 <= seed < 2**62:
        raise ValueError(f"seed: {seed} is not allowed; whole numbers in [0, 2**62) are")
    return int(seed)


class _Loops:
    """Common base of both forms."""

    def _make(self, scenario, settings, action, preview_s, count):
        self._core = _core.Batch(os.fspath(scenario), _overrides(settings or {}), action, list(map(float, preview_s)), count)
        self.action_names = [name for name, _, _ in self._core.actions()]
        self.observation_names = [name for name, _, _ in self._core.observations()]
        twists = len(self.action_names) // 2
        self._box = self._space(self._core.observations(), (len(self.observation_names),))
        self._action_box = self._space(self._core.actions(), (twists, 2) if action == "plan" else (len(self.action_names),))

    @staticmethod
    def _space(numbers, shape):
        low, high = (np.array([number[k] for number in numbers]).reshape(shape) for k in (1, 2))
        return Box(low, high, dtype=np.float64)

    def _reset(self, seed, options, count):
        if seed is None:
            seeds = []
        elif isinstance(seed, (list, tuple, np.ndarray)):
            if len(seed) != count:
                raise ValueError(f"seed: {len(seed)} seeds are not allowed; allowed: {count}, or one number")
            seeds = [_seed(one) for one in seed]
        else:
            seeds = [_seed(seed) + i for i in range(count)]
        options = options or {}
        for name in options:
            if name not in _OPTIONS:
                raise ValueError(f"options: there is no {name!r}; allowed: {', '.join(_OPTIONS)}")
        settings = options.get("settings") or {}
        if isinstance(settings, (list, tuple)):
            if len(settings) != count:
                raise ValueError(f"options: settings of {len(settings)} loops are not allowed; allowed: {count}")
            each = [_overrides(one) for one in settings]
        else:
            each = [_overrides(settings)] * count if settings else []
        log = options.get("log")
        if log is not None and count > 1:
            raise ValueError("options: log is of one loop; allowed with several: none")
        return self._core.reset(seeds, each, os.fspath(log or ""))

    def path_at(self, t_s):
        """The scenario's path at these times [s], a row each: x_m, y_m, yaw_rad, v_mps, omega_radps."""
        return self._core.path_at(np.atleast_1d(np.asarray(t_s, np.float64)))

    @property
    def scenario(self):
        """The resolved scenario as TOML."""
        return self._core.scenario()


class Env(_Loops, _Env):
    """One closed loop of a scenario.

    scenario   a scenario's file
    settings   of its keys, as --set has them: {"channel.prr": 0.5}
    action     "twist": [v_mps, omega_radps]; "plan": an array of n such rows, the twists of
               controller.plan_step_ms each; "tau": [tau_s, send]; "send": [send]
    preview_s  look-ahead times at which the path's point is observed, too

    An episode is a run from t = 0 to run.duration_s; then it is truncated. None is terminated.
    """

    metadata = {"render_modes": []}
    render_mode = None
    spec = None

    def __init__(self, scenario, settings=None, action="twist", preview_s=()):
        self._make(scenario, settings, action, preview_s, 1)
        self.observation_space = self._box
        self.action_space = self._action_box

    def reset(self, *, seed=None, options=None):
        """options: settings, a dict of scenario keys for this episode; log, a file for its messages."""
        if _Env is not object:
            super().reset(seed=seed)
        observation, info = self._reset(seed, options, 1)
        return observation[0], {name: column.item() for name, column in info.items()}

    def step(self, action):
        action = _numbers(action, self.action_space.shape)
        observation, reward, ended, info = self._core.step(action, _core.AfterEnd.refuses)
        return observation[0], reward.item(), False, ended.item(), {name: c.item() for name, c in info.items()}

    def render(self):
        return None

    def close(self):
        pass


class VectorEnv(_Loops, _VectorEnv):
    """num_envs closed loops of a scenario, stepped at once: arrays of actions in, of results out.

    A loop that was truncated begins its next episode in the next step (Gymnasium's NEXT_STEP): that
    step's action of this loop is not looked at, its reward is 0. The i-th loop's first seed is
    seed + i, or seed[i] of a list; each further episode takes the seed after the highest there was.
    Settings stay. With autoreset=False it rests instead (DISABLED), truncated, with a reward of 0, until
    reset() begins an episode of all.
    """

    metadata = {"render_modes": [], "autoreset_mode": _NEXT_STEP}
    render_mode = None
    spec = None

    def __init__(self, num_envs, scenario, settings=None, action="twist", preview_s=(), autoreset=True):
        if isinstance(num_envs, bool) or not isinstance(num_envs, (int, np.integer)):
            raise TypeError(f"num_envs: {num_envs!r} is not allowed; a whole number >= 1 is")
        if num_envs < 1:
            raise ValueError(f"num_envs: {num_envs} is not allowed; whole numbers >= 1 are")
        self.num_envs = int(num_envs)
        self._make(scenario, settings, action, preview_s, self.num_envs)
        self.single_observation_space, self.single_action_space = self._box, self._action_box
        self.observation_space = batch_space(self._box, self.num_envs)
        self.action_space = batch_space(self._action_box, self.num_envs)
        self._after_end = _core.AfterEnd.restarts if autoreset else _core.AfterEnd.rests
        if not autoreset:
            self.metadata = self.metadata | {"autoreset_mode": _DISABLED}
        self._terminated = np.zeros(self.num_envs, bool)

    def reset(self, *, seed=None, options=None):
        """options: settings, a dict of scenario keys for these and further episodes, or one for each loop."""
        return self._reset(seed, options, self.num_envs)

    def step(self, actions):
        actions = _numbers(actions, self.action_space.shape)
        observation, reward, ended, info = self._core.step(actions, self._after_end)
        return observation, reward, self._terminated.copy(), ended, info

    def render(self):
        return None

    def close(self, **_):
        pass
