#!/usr/bin/env -S python3 -B
"""Nodes of `tether run --processes` that are killed or stopped, and a coordinator that is ended, at times that a seed
chooses: the run fails, says so and leaves no summary, or its log is byte for byte that of an undisturbed run. Never another
result with exit code 0. Usage: kill_campaign_test.py BIN_DIR [KILLS [SEED]]"""

import contextlib
import os
import random
import signal
import sys
import time

from live_support import PAPER, alive, check, main, wait_until

RANDOM = ("--set", "sensor.rate_hz=20", "--set", "sensor.position_noise_m=0.02", "--set", "channel.prr=0.7")
RANDOM += ("--set", "channel.delay_ms=35", "--set", "run.duration_s=6")
WAYS = (signal.SIGKILL, signal.SIGTERM, signal.SIGSTOP, signal.SIGSEGV)
PATIENCE_S = 1


def log_of(out):
    log = out / "run.lcmlog"
    return log.read_bytes() if log.exists() else b""


def disturbed(test, out, choice, seconds):
    """Exit code, who was hit how, and what the run said, of a run that is hit somewhere within these seconds."""
    run = test.start("tether", "run", PAPER, "--processes", f"--patience={PATIENCE_S}", "--out", out, *RANDOM)
    wait_until(10, lambda: len(run.children()) == 3 or not run.running(), "its nodes")
    nodes = run.children() | {"tether": run.pid}
    time.sleep(choice.uniform(0.0, seconds))
    victim, way = choice.choice(sorted(nodes)), choice.choice(WAYS)
    with contextlib.suppress(ProcessLookupError):
        os.kill(nodes[victim], way)
    if victim == "tether" and way == signal.SIGSTOP:
        time.sleep(0.2)
        run.kill(signal.SIGCONT)
    code = run.wait(30)
    wait_until(5, lambda: not any(map(alive, nodes.values())), f"nodes are left after {way.name} of {victim}")
    return code, f"{way.name} of {victim}", run.err()


def no_kill_changes_a_result_with_exit_code_0(test):
    kills, seed = [*map(int, sys.argv[2:]), *(25, 1)[len(sys.argv) - 2 :]]
    began = time.monotonic()
    right = test.run("tether", "run", PAPER, "--processes", "--out", test.work / "right", *RANDOM, seconds=60)
    took = time.monotonic() - began
    check(right.process.returncode == 0, right.err())
    whole = log_of(test.work / "right")
    check(len(whole) > 100_000, f"a log of {len(whole)} bytes")
    choice = random.Random(seed)
    ended = 0
    for i in range(kills):
        out = test.work / f"kill {i}"
        code, what, said = disturbed(test, out, choice, took)
        if code == 0:
            check(log_of(out) == whole, f"{what}: another result with exit code 0: {said}")
            continue
        ended += 1
        check(not (out / "summary.json").exists(), f"{what}: exit code {code}, and a summary")
        check(whole.startswith(log_of(out)[:-200]) or not log_of(out), f"{what}: the log is no beginning of the right one")
    check(ended > kills / 3, f"only {ended} of {kills} kills met a run")
    test.say(f"{kills} kills: {ended} ended a run, {kills - ended} had no effect, none changed a result "
             f"(at most {3 / kills:.1e} of them do, with 95 % confidence)")


main(no_kill_changes_a_result_with_exit_code_0)
