#!/usr/bin/env -S /usr/bin/python3 -B
"""tether_env: its runs are those of `tether run`, bit for bit; what it refuses, it refuses by name.
Usage: env_test.py BIN_DIR"""

import json
import math
import pathlib
import subprocess
import sys
import threading
import time
import unittest
from concurrent.futures import ThreadPoolExecutor

SOURCE = pathlib.Path(__file__).resolve().parents[2]
BIN = pathlib.Path(sys.argv.pop(1)).resolve()
sys.path[:0] = [str(BIN.parent / "python"), str(SOURCE / "python")]
import numpy as np

import tether
import tether_env
from folder import WithAFolder

PAPER = SOURCE / "scenarios" / "paper.toml"
FAST = {"vehicle.plant": "kinematic", "sensor.rate_hz": 20, "run.duration_s": 10}
BAD = FAST | {"channel.prr": 0.7, "channel.delay_ms": 50, "sensor.position_noise_m": 0.02}


def run_tether(settings, out, seed):
    sets = [f"--set={key}={value}" for key, value in settings.items()]
    command = [BIN / "tether", "run", PAPER, "--seed", str(seed), "--out", out, *sets]
    subprocess.run(command, check=True, capture_output=True)


def to_the_end(env, act, **reset):
    """The rewards of an episode, and its last info."""
    observation, info = env.reset(**reset)
    rewards, truncated = [], False
    while not truncated:
        observation, reward, terminated, truncated, info = env.step(act(observation, info))
        assert not terminated
        rewards.append(reward)
    return rewards, info


class Runs(WithAFolder):
    def test_of_the_shipping_law_are_tether_runs_byte_for_byte(self):
        for settings in (FAST, BAD | {"controller.trigger": "timer"}, BAD | {"vehicle.plant": "ode"}):
            out = self.work / "run"
            run_tether(settings, out, 7)
            env = tether_env.Env(PAPER, settings, action="tau")
            log = self.work / "env.lcmlog"
            rewards, info = to_the_end(env, lambda *_: [2.0, 1.0], seed=7, options={"log": log})
            self.assertEqual(log.read_bytes(), (out / "run.lcmlog").read_bytes())
            summary = json.loads((out / "summary.json").read_text())
            for name in ("epsilon_m", "rmse_m", "max_error_m", "wall_contact_s"):
                self.assertEqual(info[name], summary[name], name)
            self.assertAlmostEqual(sum(rewards), -10 * summary["epsilon_m"], places=9)

    def test_of_a_law_in_python_are_those_of_the_same_law_in_cpp(self):
        settings = BAD | {"controller.v.d": 0, "controller.omega.d": 0}
        run_tether(settings, self.work / "run", 3)
        env = tether_env.Env(PAPER, settings)

        def law(_, info):  # the paper's PID with P gains alone; hypot as C has it
            x_m, y_m, *_ = env.path_at(info["t_s"] + 2.0)[0]
            dx, dy = x_m - info["x_m"], y_m - info["y_m"]
            heading_error = math.remainder(math.atan2(dy, dx) - info["yaw_rad"], 2 * math.pi)
            return [0.495 * abs(complex(dx, dy)), 0.2925 * heading_error]

        to_the_end(env, law, seed=3, options={"log": self.work / "env.lcmlog"})
        channels = "SIM/TRUTH|CTRL/CMD_VEL|AGV/CMD_VEL|AGV/POSE|CTRL/POSE"
        ours = list(tether.read_log(self.work / "env.lcmlog", channels))
        self.assertGreater(len(ours), 500)
        self.assertEqual(ours, list(tether.read_run(self.work / "run").log(channels)))

    def test_are_the_same_again_and_others_with_another_seed(self):
        env = tether_env.Env(PAPER, BAD, action="send")
        first, again, other = (to_the_end(env, lambda *_: [1], seed=seed)[0] for seed in (1, 1, 2))
        self.assertEqual(first, again)
        self.assertNotEqual(first, other)

    def test_go_on_with_further_seeds_from_the_scenarios_own(self):
        env = tether_env.Env(PAPER, FAST | {"run.duration_s": 1, "run.seed": 40}, action="send")
        self.assertEqual([to_the_end(env, lambda *_: [1])[1]["seed"] for _ in range(3)], [40, 41, 42])
        self.assertEqual([to_the_end(env, lambda *_: [1], seed=s)[1]["seed"] for s in (7, None)], [7, 8])


class Vectors(unittest.TestCase):
    def test_are_as_many_single_loops_and_restart_after_their_ends(self):
        short = BAD | {"run.duration_s": 2}
        each = [{"channel.prr": 1.0}, {"channel.prr": 0.5}, {"run.duration_s": 3}]
        many = tether_env.VectorEnv(3, PAPER, short, action="tau")
        one = [tether_env.Env(PAPER, short | own, action="tau") for own in each]
        seeds, next_seed = [5, 6, 7], 8
        observations, _ = many.reset(seed=5, options={"settings": each})
        for i, env in enumerate(one):
            np.testing.assert_array_equal(observations[i], env.reset(seed=seeds[i])[0])
        over, ends = [False] * 3, 0
        for step in range(150):
            actions = np.column_stack([np.full(3, 1.0 + step % 3), np.ones(3)])
            observations, rewards, terminated, truncated, infos = many.step(actions)
            self.assertFalse(terminated.any())
            for i, env in enumerate(one):
                if over[i]:
                    seeds[i], next_seed = next_seed, next_seed + 1
                    (observation, info), reward, over[i] = env.reset(seed=seeds[i]), 0.0, False
                else:
                    observation, reward, _, over[i], info = env.step(actions[i])
                np.testing.assert_array_equal(observations[i], observation)
                self.assertEqual((rewards[i], truncated[i]), (reward, over[i]))
                self.assertEqual(infos["t_s"][i], info["t_s"])
                if over[i]:
                    ends += 1
                    self.assertTrue(infos["ended"][i])
                    self.assertEqual((infos["seed"][i], infos["epsilon_m"][i]), (seeds[i], info["epsilon_m"]))
        self.assertGreater(ends, 6)

    def test_rest_after_their_ends_without_autoreset(self):
        many = tether_env.VectorEnv(2, PAPER, FAST, action="send", autoreset=False)
        many.reset(seed=4, options={"settings": [{"channel.prr": 0.5}, {}]})
        returns, truncated, steps = np.zeros(2), np.zeros(2, bool), np.zeros(2, int)
        while not truncated.all():
            steps += ~truncated
            observations, rewards, _, truncated, infos = many.step(np.ones((2, 1)))
            returns += rewards
        self.assertLess(steps[0], 0.7 * steps[1])
        np.testing.assert_array_equal(infos["seed"], [4, 5])
        np.testing.assert_allclose(returns, -10 * infos["epsilon_m"], rtol=1e-12)
        np.testing.assert_array_equal(many.step(np.ones((2, 1)))[0], observations)

    def test_take_a_list_of_seeds(self):
        many = tether_env.VectorEnv(2, PAPER, BAD, action="send")
        observations = many.reset(seed=[9, 9])[0]
        np.testing.assert_array_equal(observations[0], observations[1])
        self.assertFalse(np.array_equal(*many.reset(seed=[9, 10])[0]))

    def test_let_other_threads_run_meanwhile(self):
        many = tether_env.VectorEnv(40, PAPER, FAST | {"sensor.rate_hz": 0.2, "run.duration_s": 60}, action="send")
        many.reset(seed=1)
        moments, done = [], threading.Event()

        def count():
            while not done.is_set():
                moments.append(time.perf_counter())
                time.sleep(0)

        counter = threading.Thread(target=count)
        counter.start()
        within = 0
        for _ in range(10):
            begin = time.perf_counter()
            many.step(np.ones((40, 1)))
            end = time.perf_counter()
            within += sum(begin + 0.1 * (end - begin) < t < end - 0.1 * (end - begin) for t in moments)
        done.set()
        counter.join()
        self.assertGreater(within, 20)

    def test_are_the_same_in_threads_side_by_side(self):
        def rewards(seed):
            many = tether_env.VectorEnv(4, PAPER, BAD, action="send")
            many.reset(seed=seed)
            return np.array([many.step(np.ones((4, 1)))[1] for _ in range(100)])

        alone = [rewards(seed) for seed in (1, 5)]
        with ThreadPoolExecutor(2) as pool:
            for a, b in zip(alone, pool.map(rewards, (1, 5)), strict=True):
                np.testing.assert_array_equal(a, b)

    def test_that_two_threads_step_at_once_are_an_exception_and_go_on(self):
        many = tether_env.VectorEnv(64, PAPER, FAST | {"run.duration_s": 60}, action="send")
        many.reset(seed=1)
        refused = []

        def steps():
            for _ in range(200):
                try:
                    many.step(np.ones((64, 1)))
                except tether_env.ResetNeeded as error:
                    refused.append(str(error))

        threads = [threading.Thread(target=steps) for _ in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertTrue(refused)
        self.assertIn("another thread", refused[0])
        many.reset(seed=1)
        many.step(np.ones((64, 1)))


class Spaces(unittest.TestCase):
    def test_say_what_comes_and_what_may_go(self):
        plans = BAD | {"controller.law": "predictive", "actuator.policy": "horizon", "controller.horizon_s": 1}
        for action, settings, shape in (("twist", BAD, (2,)), ("tau", BAD, (2,)), ("send", BAD, (1,)), ("plan", plans, (20, 2))):
            env = tether_env.Env(PAPER, settings, action=action, preview_s=[0.5, 1])
            self.assertEqual(env.action_space.shape, shape)
            observation, _ = env.reset(seed=1)
            self.assertEqual(observation.shape, (len(env.observation_names),))
            for _ in range(100):
                self.assertTrue(env.observation_space.contains(observation), observation)
                taken = env.action_space.sample()
                self.assertTrue(env.action_space.contains(taken))
                observation, reward, *_ = env.step(taken)
                self.assertIsInstance(reward, float)
                self.assertLessEqual(reward, 0)
        self.assertIn("acknowledged_age_s", env.observation_names)
        self.assertEqual(env.observation_names[-1], "left_m@1")

    def test_of_ones_own_hold_what_they_draw_and_nothing_else(self):
        box = tether_env.Box(np.array([-1.0, 0.0, -np.inf, -np.inf]), np.array([1.0, np.inf, 2.0, np.inf]), dtype=np.float64)
        for _ in range(100):
            self.assertTrue(box.contains(box.sample()))
        self.assertFalse(box.contains(np.array([0.0, -0.1, 0.0, 0.0])))
        self.assertFalse(box.contains(np.array([np.nan, 1.0, 0.0, 0.0])))
        self.assertFalse(box.contains(np.zeros(3)))


class Refusals(WithAFolder):
    def expect(self, error, words, call, *arguments, **named):
        with self.assertRaises(error) as raised:
            call(*arguments, **named)
        for word in words.split("|"):
            self.assertIn(word, str(raised.exception))

    def test_of_actions_name_what_is_allowed(self):
        env = tether_env.Env(PAPER, FAST)
        env.reset(seed=1)
        self.expect(ValueError, "action[0] (v_mps) is 9|[-8, 8]", env.step, [9, 0])
        self.expect(ValueError, "action[1] (omega_radps) is nan|[-2, 2]", env.step, [0, math.nan])
        self.expect(ValueError, "shape (3,)|(2,)", env.step, [0, 0, 0])
        self.expect(ValueError, "shape (1, 2)|(2,)", env.step, [[0, 0]])
        self.expect(TypeError, "dtype|float64", env.step, ["a", "b"])
        self.expect(TypeError, "dtype|float64", env.step, [1 + 2j, 0])
        env.step(np.array([1, 0], np.float32))  # after a refusal it goes on
        many = tether_env.VectorEnv(2, PAPER, FAST)
        many.reset(seed=1)
        self.expect(ValueError, "of loop 1|action[0] (v_mps) is -9", many.step, [[0, 0], [-9, 0]])

    def test_of_steps_without_an_episode_say_reset(self):
        env = tether_env.Env(PAPER, FAST | {"run.duration_s": 1}, action="send")
        self.expect(tether_env.ResetNeeded, "reset()", env.step, [1])
        to_the_end(env, lambda *_: [1], seed=1)
        self.expect(RuntimeError, "over|reset()", env.step, [1])
        env.reset()
        env.step([1])

    def test_of_scenarios_and_options_name_what_is_allowed(self):
        self.expect(ValueError, "nonsense.toml", tether_env.Env, "nonsense.toml")
        self.expect(ValueError, "channel.uplink.prr|[0, 1]", tether_env.Env, PAPER, {"channel.prr": 2})
        self.expect(ValueError, "wheel|twist", tether_env.Env, PAPER, action="wheel")
        self.expect(ValueError, "predictive|pid", tether_env.Env, PAPER, action="plan")
        self.expect(ValueError, "fleet.count", tether_env.Env, PAPER, {"fleet.count": 2})
        self.expect(ValueError, "preview_s", tether_env.Env, PAPER, preview_s=[-1])
        self.expect(TypeError, "settings|dict", tether_env.Env, PAPER, ["channel.prr=1"])
        self.expect(ValueError, "num_envs|>= 1", tether_env.VectorEnv, 0, PAPER)
        env = tether_env.Env(PAPER, FAST)
        self.expect(ValueError, "speed|settings, log", env.reset, options={"speed": 1})
        self.expect(ValueError, "seed|[0, ", env.reset, seed=-1)
        self.expect(TypeError, "seed", env.reset, seed=1.5)
        self.expect(ValueError, "controller.v.limit", env.reset, options={"settings": {"controller.v.limit": 2}})
        self.expect(ValueError, "none.lcmlog", env.reset, options={"log": self.work / "no" / "none.lcmlog"})
        many = tether_env.VectorEnv(2, PAPER, FAST)
        self.expect(ValueError, "settings|2", many.reset, options={"settings": [{}]})
        self.expect(ValueError, "log", many.reset, options={"log": self.work / "log"})


if __name__ == "__main__":
    unittest.main()
