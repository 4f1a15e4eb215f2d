#!/usr/bin/env -S python3 -B
"""A disk that is full: the reason is named at once, results are shown, and nothing that was there is
lost. Usage: disk_full_test.py BIN_DIR"""

import os
import subprocess
import sys
import time

from live_support import PAPER, check, main

REASON = "No space left on device"


def small_disk(test, kilobytes):
    """A tmpfs of this mount namespace, which is ours alone."""
    disk = test.work / f"disk{kilobytes}"
    disk.mkdir()
    subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", str(disk)], check=True
    )
    return disk


def live_says_so_at_once_and_still_sums_up(test):
    disk = small_disk(test, 64)
    (disk / "filler").write_bytes(bytes(12 * 1024))
    live = test.start(
        "tether", "live", PAPER, "--set=sensor.rate_hz=20", "--duration=6", "--out", disk / "run"
    )
    full = None
    while REASON not in live.err():
        check(live.process.poll() is None, f"ended unheard: {live.err()}")
        if full is None and os.statvfs(disk).f_bavail == 0:
            full = time.monotonic()
        time.sleep(0.02)
    told_s = time.monotonic() - full
    check(told_s < 1.0, f"told {told_s:.2f} s after the disk was full")
    check("the run goes on" in live.err(), live.err())
    check(live.wait(12) == 1, f"exit code {live.process.returncode}: {live.err()}")
    check("ε = " in live.out(), f"no summary: {live.out()}")
    test.say(f"told {told_s:.2f} s after the disk was full: {live.err().strip()}")


def run_keeps_an_earlier_runs_results(test):
    disk = small_disk(test, 4096)
    first = test.run("tether", "run", PAPER, "--set=run.duration_s=5", "--out", disk / "run")
    check(first.process.returncode == 0, first.err())
    before = {p.name: p.read_bytes() for p in (disk / "run").iterdir()}
    with open(disk / "filler", "wb", buffering=0) as filler:
        try:
            while filler.write(bytes(4096)):
                pass
        except OSError:
            pass
    again = test.run("tether", "run", PAPER, "--set=run.duration_s=5", "--out", disk / "run")
    check(again.process.returncode == 1, f"exit code {again.process.returncode}")
    check(REASON in again.err(), again.err())
    after = {p.name: p.read_bytes() for p in (disk / "run").iterdir()}
    check(before == after, f"changed: {sorted(before)} became {sorted(after)}")
    os.remove(disk / "filler")
    test.say(again.err().strip())


def run_names_the_reason_when_the_log_does_not_fit(test):
    disk = small_disk(test, 96)
    run = test.run("tether", "run", PAPER, "--out", disk / "run")
    check(run.process.returncode == 1, f"exit code {run.process.returncode}")
    check(REASON in run.err() and "ε = " in run.out(), run.err() + run.out())


if os.environ.get("TETHER_OWN_MOUNTS") != "yes":
    os.environ["TETHER_OWN_MOUNTS"] = "yes"
    own = ["unshare", "--mount"] if os.getuid() == 0 else ["unshare", "-r", "--mount"]
    os.execvp(own[0], [*own, sys.executable, "-B", *sys.argv])
main(
    live_says_so_at_once_and_still_sums_up,
    run_keeps_an_earlier_runs_results,
    run_names_the_reason_when_the_log_does_not_fit,
)
