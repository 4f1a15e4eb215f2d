#!/usr/bin/env -S python3 -B
"""`tether run --processes` on a network that loses, doubles, delays and reorders datagrams of coordinator and nodes, as
tests/support/lossy_network.cpp does by a seed: logs and trajectories are byte for byte those of one process, or the run
fails, gives its reason and leaves no summary. Never another result with exit code 0.
Usage: lossy_lockstep_test.py BIN_DIR [RUNS [FIRST_SEED]]"""

import concurrent.futures
import os
import random
import re
import struct
import sys

from live_support import PAPER, SOURCE, check, main

SCENARIOS = {
    "paper": (PAPER, "--set=sensor.rate_hz=20", "--set=sensor.position_noise_m=0.02", "--set=channel.prr=0.7",
              "--set=channel.delay_ms=35", "--set=run.duration_s=2"),
    "drives on CAN": (SOURCE / "scenarios" / "hil_vcan.toml", "--set=run.duration_s=0.5"),
    "localised by scans": (SOURCE / "scenarios" / "factory.toml", "--set=run.duration_s=0.5"),
}
RATES = (0.002, 0.01, 0.04, 0.6)  # rates of each fault; with the last, hardly a run completes
# A run that loses little must come to its end, on a machine however busy; one that loses much is not waited for.
PATIENCE_S = (120, 120, 120, 4)
FILES = ("run.lcmlog", "trajectory.csv")
SHORT = 12
AT_ONCE = 8  # they mostly wait for what was lost


def files_of(out):
    return [(out / name).read_bytes() if (out / name).exists() else b"" for name in FILES]


def lossy_run(test, shim, seed, scenario):
    """The faults, whether it came to its end, and what it said."""
    out, counts = test.work / f"lossy {seed}", test.work / f"counts_{seed}"
    counts.write_bytes(bytes(24))
    choice = random.Random(seed)
    rate = RATES[seed % len(RATES)]
    faults = " ".join(str(rate * choice.uniform(0.5, 1)) for _ in range(3))
    environment = os.environ | {"LD_PRELOAD": str(shim), "TETHER_LOSSY": f"{seed} {faults} {counts}"}
    run = test.run("tether", "run", *SCENARIOS[scenario], "--processes", f"--patience={PATIENCE_S[seed % len(RATES)]}", "--out", out,
                   seconds=230, env=environment)
    return struct.unpack("3Q", counts.read_bytes()), run.process.returncode, out, run.err()


def no_lost_datagram_changes_a_result_with_exit_code_0(test):
    runs, first = [*map(int, sys.argv[2:]), *(SHORT, 0)[len(sys.argv) - 2 :]]
    shim = test.bin.parent / "tests" / "liblossy_network.so"
    check(shim.exists(), f"{shim} is missing")
    right = {}
    for name, options in SCENARIOS.items():
        check(test.run("tether", "run", *options, "--out", test.work / name, seconds=60).process.returncode == 0, name)
        right[name] = files_of(test.work / name)
        check(len(right[name][0]) > 10_000, f"{name}: a log of {len(right[name][0])} bytes")
    names = list(SCENARIOS)
    of_run = {seed: names[seed // len(RATES) % len(names)] for seed in range(first, first + runs)}
    sums, failed = [0, 0, 0], []
    with concurrent.futures.ThreadPoolExecutor(AT_ONCE) as pool:
        results = pool.map(lambda seed: lossy_run(test, shim, seed, of_run[seed]), of_run)
        for (seed, name), (counts, code, out, said) in zip(of_run.items(), results):
            what = f"seed {seed}, {name}, {counts} faults"
            sums = [a + b for a, b in zip(sums, counts)]
            if code == 0:
                for file, one, other in zip(FILES, right[name], files_of(out)):
                    check(one == other, f"{what}: another {file} with exit code 0: {said}")
                continue
            reason = (out / "incomplete.txt").read_text() if (out / "incomplete.txt").exists() else said
            check(code == 1 and re.search(r"\b(sim|netem|controller|can|localiser|joined?)\b", reason), f"{what}: {code}: {said}")
            check(not (out / "summary.json").exists(), f"{what}: exit code {code}, and a summary")
            failed.append((seed, reason.splitlines()[0]))
    for seed, reason in failed:
        test.say(f"seed {seed}: {reason}")
    test.say(f"{sum(sums)} faults in {runs} runs: {sums[0]} datagrams lost, {sums[1]} doubled, {sums[2]} late; "
             f"{len(failed)} runs failed by name, none had another result")
    light = [seed for seed, _ in failed if seed % len(RATES) < 3]
    check(not light, f"these seeds lose little and must come to their end: {light}")
    check(min(sums) > 2 * runs, f"only {sums} faults")


main(no_lost_datagram_changes_a_result_with_exit_code_0)
