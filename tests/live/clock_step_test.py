#!/usr/bin/env -S python3 -B
"""The wall clock is set while a live run lasts: nodes that are started again since then join at the
right time. The clock is the kernel's in User-Mode Linux, whose clock no other program uses; else one that
is preloaded. Usage: clock_step_test.py BIN_DIR"""

import os
import signal
import subprocess
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


class PreloadedClock:
    """The programs of the run get another wall clock than the test."""

    def __init__(self, test):
        shim = test.bin.parent / "tests" / "libstepped_clock.so"
        check(shim.is_file(), f"{shim} is missing")
        self.file = test.work / "step"
        self.environment = {"LD_PRELOAD": str(shim), "TETHER_CLOCK_STEP": str(self.file)}

    def step(self, total_s):
        self.file.write_text(f"{total_s}\n")


class KernelsClock:
    """`date -s`: for all processes, this one too."""

    environment = {}

    def __init__(self, test):
        self.network = test.network
        self.ahead_s = 0

    def step(self, total_s):
        target_s = time.time() + total_s - self.ahead_s
        subprocess.run(["date", "-s", f"@{target_s:.6f}"], check=True, stdout=subprocess.DEVNULL)
        self.ahead_s = total_s
        check(abs(time.time() - target_s) < 1, "the clock has not been set")
        self.network.forget()


def nodes_started_after_a_step_join_at_the_right_time(test):
    in_guest = os.environ.get("TETHER_CAN_KERNEL") == "uml"
    clock = KernelsClock(test) if in_guest else PreloadedClock(test)
    live = test.start("tether", "live", PAPER, *FAST, env=os.environ | clock.environment)
    wait_for_loop(test.network)
    for step_s in (2, -2, 3600, -3600):
        clock.step(step_s)
        for victim in NODES:
            restart(test, live, victim)
        check(abs(apart_s(test)) < 0.2, f"{apart_s(test)} s apart after a step of {step_s} s")
        test.say(f"a step of {step_s} s: all nodes started again, {1e3 * apart_s(test):+.0f} ms apart")
    live.kill(signal.SIGINT)
    check(live.wait(5) == 0, f"exit code: {live.err()}")


main(nodes_started_after_a_step_join_at_the_right_time)
