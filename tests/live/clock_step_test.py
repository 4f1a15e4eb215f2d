#!/usr/bin/env -S python3 -B
"""The wall clock is set while a live run lasts: nodes that are started again since then join at the
right time. Usage: clock_step_test.py BIN_DIR"""

import os
import signal
import time

from live_support import NODES, PAPER, check, main, wait_for_loop, wait_until

FAST = ("--set=sensor.rate_hz=20", "--set=controller.pose_timeout_s=0.5")


def restart(test, live, victim):
    before = live.children()[victim]
    os.kill(before, signal.SIGKILL)
    wait_until(5, lambda: live.children().get(victim, before) != before, f"{victim} again")
    wait_for_loop(test.network, since=time.time())


def apart_s(test):
    """How far the controller's time is from the simulator's."""
    report, truth = test.network.last("CTRL/REPORT"), test.network.last("SIM/TRUTH")
    return (report.utime - truth.utime) * 1e-6


def nodes_started_after_a_step_join_at_the_right_time(test):
    step = test.work / "step"
    shim = test.bin.parent / "tests" / "libstepped_clock.so"
    check(shim.is_file(), f"{shim} is missing")
    environment = os.environ | {"LD_PRELOAD": str(shim), "TETHER_CLOCK_STEP": str(step)}
    live = test.start("tether", "live", PAPER, *FAST, env=environment)
    wait_for_loop(test.network)
    for step_s in (2, -2, 3600, -3600):
        step.write_text(f"{step_s}\n")
        for victim in NODES:
            restart(test, live, victim)
        check(abs(apart_s(test)) < 0.2, f"{apart_s(test)} s apart after a step of {step_s} s")
        test.say(f"a step of {step_s} s: all nodes started again, {1e3 * apart_s(test):+.0f} ms apart")
    live.kill(signal.SIGINT)
    check(live.wait(5) == 0, f"exit code: {live.err()}")


main(nodes_started_after_a_step_join_at_the_right_time)
