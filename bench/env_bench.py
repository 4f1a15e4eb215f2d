#!/usr/bin/env -S /usr/bin/python3 -B
"""Control steps a second of tether_env, one core: the kinematic plant and 20 poses a second; CPU time, so that
other work on the machine counts little. Usage: env_bench.py BIN_DIR"""

import os
import pathlib
import sys
import time

SOURCE = pathlib.Path(__file__).resolve().parents[1]
sys.path.insert(0, str(pathlib.Path(sys.argv[1]).resolve().parent / "python"))
import numpy as np

import tether_env

PAPER = SOURCE / "scenarios" / "paper.toml"
ROUNDS = 1 if os.environ.get("TETHER_BENCH_SMOKE") else 7
FAST = {"vehicle.plant": "kinematic", "sensor.rate_hz": 20}


def single(settings, action, act):
    env = tether_env.Env(PAPER, FAST | settings, action=action)
    env.reset(seed=1)
    steps, truncated = 0, False
    began = time.process_time()
    while not truncated:
        _, _, _, truncated, _ = env.step(act)
        steps += 1
    return steps / (time.process_time() - began)


def vector(n, settings, action, act):
    env = tether_env.VectorEnv(n, PAPER, FAST | settings, action=action)
    acts = np.tile(act, (n,) + (1,) * np.ndim(act))
    env.reset(seed=1)
    steps = max(100, 40_000 // n)
    began = time.process_time()
    for _ in range(steps):
        env.step(acts)
    return n * steps / (time.process_time() - began)


def resets():
    env = tether_env.Env(PAPER, FAST)
    env.reset(seed=1)
    began = time.process_time()
    for seed in range(100):
        env.reset(seed=seed)
    return 100 / (time.process_time() - began)


def report(name, measure, *arguments):
    figures = sorted(measure(*arguments) for _ in range(ROUNDS))
    print(f"{name:44} {figures[ROUNDS // 2] / 1e3:8.1f} thousand a second", flush=True)


TWIST, TAU = np.array([1.0, 0.1]), np.array([2.0, 1.0])
LOSSES = {"channel.prr": 0.45}
PLANS = {"controller.law": "predictive", "actuator.policy": "horizon", "controller.horizon_s": 2}
report("single, twist", single, {}, "twist", TWIST)
report("single, tau", single, {}, "tau", TAU)
for n in (1, 16, 256):
    report(f"{n} at once, twist", vector, n, {}, "twist", TWIST)
report("16 at once, tau", vector, 16, {}, "tau", TAU)
report("16 at once, tau, PRR 0.45", vector, 16, LOSSES, "tau", TAU)
report("16 at once, plans of 40 twists", vector, 16, PLANS, "plan", np.full((40, 2), 0.1))
report("16 at once, a pose a second, twist", vector, 16, {"sensor.rate_hz": 1}, "twist", TWIST)
report("resets", resets)
