#!/usr/bin/env python3
"""Learns a PID's gains, and its look-ahead by the share of poses that arrive, by the cross-entropy method;
then compares it with laws that were designed and tuned manually, on seeds that it has not seen.

    examples/learn_pid.py [GENERATIONS [UNSEEN_SEEDS]]   # from the source tree; numpy and tether_env, two threads

Cross-entropy: R. Rubinstein, The cross-entropy method for combinatorial and continuous optimization.
Methodology and Computing in Applied Probability 1 (2), 1999."""

import pathlib
import sys
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor

import numpy as np

import tether_env

SOURCE = pathlib.Path(__file__).resolve().parents[1]
PAPER = SOURCE / "scenarios" / "paper.toml"
# Same scenario as in experiments/control_benchmark.toml, with 20 poses a second.
BASE = {
    "vehicle.plant": "kinematic", "vehicle.start_error_m": 0.1, "vehicle.start_error_rad": 0.05,
    "sensor.position_noise_m": 0.02, "sensor.yaw_noise_rad": 0.01, "sensor.rate_hz": 20,
}
PRRS = [1.0, 0.65, 0.45, 0.3]
GAINS = ["controller.v.p", "controller.v.d", "controller.omega.p", "controller.omega.d"]
# Logarithms of the gains and of τ where all arrives, and how fast log τ grows with what does not.
START = np.log([0.495, 0.15, 0.2925, 0.16, 2.0, 1.0]) * [1, 1, 1, 1, 1, 0]  # the paper's
SPREAD = np.array([1.0, 1.0, 1.0, 1.0, 0.7, 1.0])
CANDIDATES, ELITE, SEEDS, WORST_M = 32, 6, 3, 10.0
THREADS = 2


def gains_of(candidate):
    return {name: float(f"{np.exp(x):.4g}") for name, x in zip(GAINS, candidate)}


def errors(jobs, settings, action, act):
    """ε and whether it was lost, of each (settings, seed) of `jobs`: all are stepped at once in a thread."""
    env = tether_env.VectorEnv(len(jobs), PAPER, BASE | settings, action=action, autoreset=False)
    observations, _ = env.reset(seed=[seed for _, seed in jobs], options={"settings": [own for own, _ in jobs]})
    truncated = np.array([False])
    while not truncated.all():  # where more poses arrive there are more decisions
        observations, _, _, truncated, infos = env.step(act(observations))
    return infos["epsilon_m"], infos["lost"] > 0


def in_threads(pool, jobs, work):
    parts = [range(k, len(jobs), THREADS) for k in range(THREADS)]
    results = np.empty((len(jobs), 2))
    for part, result in zip(parts, pool.map(work, parts)):
        results[list(part)] = np.transpose(result)
    return results[:, 0], results[:, 1]


def of_candidates(pool, candidates, seeds):
    """ε and losses by candidate, PRR and seed."""
    jobs = [(gains_of(c) | {"channel.prr": prr}, seed) for c in candidates for prr in PRRS for seed in seeds]
    tau = np.repeat(candidates[:, 4:], len(PRRS) * len(seeds), axis=0)
    reception = tether_env.Env(PAPER, BASE, action="tau").observation_names.index("pose_reception")

    def work(part):
        def act(observations):
            tau_s = np.exp(tau[part, 0] + tau[part, 1] * (1 - observations[:, reception]))
            return np.column_stack([np.minimum(tau_s, 60.0), np.ones(len(part))])

        return errors([jobs[i] for i in part], {}, "tau", act)

    shape = (len(candidates), len(PRRS), len(seeds))
    return [result.reshape(shape) for result in in_threads(pool, jobs, work)]


def learn(pool, generations):
    random = np.random.default_rng(1)
    mean, spread = START.copy(), SPREAD.copy()
    for generation in range(generations):
        candidates = mean + spread * random.normal(size=(CANDIDATES, len(mean)))
        candidates[0] = mean
        seeds = [10_000 + SEEDS * generation + k for k in range(SEEDS)]  # others each time: none is learned by heart
        epsilon_m, _ = of_candidates(pool, candidates, seeds)
        cost = np.log(np.minimum(epsilon_m, WORST_M).mean(axis=2)).mean(axis=1)  # geometric over the PRRs
        best = candidates[np.argsort(cost)[:ELITE]]
        mean = 0.3 * mean + 0.7 * best.mean(axis=0)
        spread = 0.3 * spread + 0.7 * best.std(axis=0) + 0.01
        if generation % 5 == 0 or generation == generations - 1:
            print(f"generation {generation:2}: mean's cost {np.exp(cost[0]):6.3f} m, best {np.exp(cost.min()):6.3f} m", flush=True)
    return mean


def by_hand(name):
    """Settings of a law of experiments/gains/tuned.toml."""
    law = tomllib.loads((SOURCE / "experiments/gains/tuned.toml").read_text())["law"][name]
    flat = {}

    def flatten(table, prefix):
        for key, value in table.items():
            if isinstance(value, dict):
                flatten(value, f"{prefix}{key}.")
            else:
                flat[prefix + key] = value

    flatten(law["settings"], "")
    flatten(law["gains"], "")
    return flat


def of_law(pool, settings, seeds):
    jobs = [({"channel.prr": prr}, seed) for prr in PRRS for seed in seeds]

    def work(part):
        return errors([jobs[i] for i in part], settings, "send", lambda observations: np.ones((len(observations), 1)))

    return [result.reshape(len(PRRS), len(seeds)) for result in in_threads(pool, jobs, work)]


def interval(values):
    """95 %, of the mean, by bootstrap."""
    drawn = np.random.default_rng(2).choice(values, (10_000, len(values))).mean(axis=1)
    return np.quantile(drawn, [0.025, 0.975])


def row(name, epsilon_m, lost):
    cells = [name]
    for values, losses in zip(epsilon_m, lost):
        kept = values[losses == 0]
        cell = "-"
        if len(kept) > 1:
            cell = "{:.3f} [{:.3f}, {:.3f}]".format(kept.mean(), *interval(kept))
        cells.append(cell + (f", lost {int(losses.sum())}/{len(losses)}" if losses.any() else ""))
    print("| " + " | ".join(cells) + " |", flush=True)


def main():
    generations, seeds = (int(word) for word in sys.argv[1:] + ["40", "30"][len(sys.argv) - 1 :])
    with ThreadPoolExecutor(THREADS) as pool:
        began = time.perf_counter()
        learned = learn(pool, generations)
        runs = generations * CANDIDATES * len(PRRS) * SEEDS
        print(f"{runs} runs of 62 s in {time.perf_counter() - began:.0f} s")
        print("learned:", gains_of(learned), "τ = {:.3f} s · exp({:.3f} (1 − reception))".format(np.exp(learned[4]), learned[5]))

        unseen = range(201, 201 + seeds)
        print("| ε [m] | " + " | ".join(f"PRR {prr:g}" for prr in PRRS) + " |\n|-|" + "-|" * len(PRRS))
        epsilon_m, lost = of_candidates(pool, learned[None], unseen)
        row("PID, learned", epsilon_m[0], lost[0])
        tuned, tuned_lost = of_law(pool, by_hand("PID, 20/20 Hz"), unseen)
        row("PID, tuned", tuned, tuned_lost)
        row("PID, the paper's gains", *of_law(pool, {}, unseen))
        for name in ("tracking", "consistent"):
            row(f"{name}, tuned", *of_law(pool, by_hand(f"{name}, 20/20 Hz"), unseen))
        for prr, ours, theirs in zip(PRRS, np.minimum(epsilon_m[0], WORST_M), np.minimum(tuned, WORST_M)):
            low, high = interval(theirs - ours)
            print(f"PRR {prr:g}: the tuned PID's ε, {WORST_M:g} m at most, less the learned one's: "
                  f"{(theirs - ours).mean():.4f} m [{low:.4f}, {high:.4f}]")


if __name__ == "__main__":
    main()
