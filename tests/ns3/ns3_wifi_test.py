#!/usr/bin/env -S python3 -B
"""ns-3 judges the shared medium: the same cell of 802.11a, 54 Mbit/s with acknowledgements at 24, in both programs, with
seeds on both sides.

Without --all: what ns-3 computes in a minute, against bars. With --all: the table of docs/explanation/medium.md, in some
twenty minutes.
Usage: ns3_wifi_test.py DIR_OF_THE_TWO_PROGRAMS [--all]"""

import json
import math
import statistics
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

T95 = {1: 12.71, 2: 4.30, 3: 3.18, 4: 2.78, 5: 2.57, 6: 2.45, 7: 2.36, 8: 2.31, 9: 2.26, 19: 2.09}
LOOP = ("--pattern=loop", "--up=153", "--down=137")  # bytes of the frames of a pose and of a command


def run(program, *options):
    done = subprocess.run([program, *options], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def samples(program, seeds, seconds, *options):
    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(lambda seed: run(program, *options, f"--seconds={seconds}", f"--seed={seed}"), range(1, seeds + 1)))


class Mean:
    def __init__(self, values):
        self.mean = statistics.fmean(values)
        n = len(values)
        self.half = T95[n - 1] * statistics.stdev(values) / math.sqrt(n) if n > 1 else math.nan

    def text(self, digits):
        return f"{self.mean:.{digits}f}" + (f" ± {self.half:.{digits}f}" if self.half == self.half else "")


def rate(runs, seconds):
    return Mean([r["up"]["delivered"] / seconds for r in runs])


def share(runs, way):
    return Mean([r[way]["delivered"] / max(1, r[way]["sent"]) for r in runs])


def delay(runs, way, what="mean_us"):
    return Mean([r[way][what] for r in runs])


def agree(name, ours, judge):
    """Within 3 %, or within what their own seeds differ by."""
    allowed = max(0.03 * judge.mean, math.hypot(ours.half, judge.half))
    said = f"{name}: {ours.text(3)}, ns-3 {judge.text(3)}, allowed ± {allowed:.3f}"
    print(said, flush=True)
    assert abs(ours.mean - judge.mean) <= allowed, said


def saturated_throughput_is_ns3s(ours, ns3):
    for stations in (2, 5, 10):
        options = (f"--stations={stations}",)
        agree(f"{stations} saturated stations, frames a second", rate(samples(ours, 8, 2, *options), 2), rate(samples(ns3, 4, 1, *options), 1))


def one_vehicles_delays_differ_by_what_the_standard_says(ours, ns3):
    """44 µs in the air; SIFS and ACK 44, DIFS 34, slots of 9 µs. ns-3 waits for a DIFS though the medium was idle for
    longer (immediate access: 802.11-2016, 10.3.4.2), and its access point answers behind its own ACK without the backoff
    of a medium that was busy (10.3.4.3)."""
    options = ("--stations=1", *LOOP)
    judge, mine = samples(ns3, 1, 5, *options)[0], samples(ours, 8, 5, *options)
    assert judge["up"]["mean_us"] == 34 + 44 and judge["down"]["mean_us"] == 44 + 34 + 44, judge
    up, down = delay(mine, "up"), delay(mine, "down")
    print(f"1 vehicle: up {up.text(1)} µs, down {down.text(1)} µs; ns-3 {judge['up']['mean_us']:g} and {judge['down']['mean_us']:g}")
    assert 44 <= up.mean <= 44 + 9, up.mean
    # Backoff of 0 to 15 slots.
    assert abs(down.mean - (44 + 34 + 7.5 * 9 + 44)) < 5, down.mean


def twenty_vehicles_lose_nothing_and_wait_as_in_ns3_but_for_that(ours, ns3):
    options = ("--stations=20", *LOOP)
    judge, mine = samples(ns3, 6, 1, *options), samples(ours, 20, 2, *options)
    for way in ("up", "down"):
        assert share(judge, way).mean == 1.0 and share(mine, way).mean == 1.0, way
    # The differences of one vehicle, give or take a fifth of the 122 µs of a frame, its ACK and a DIFS, and the intervals.
    for way, alone_us in (("up", 4 - 34), ("down", 67.5)):
        mine_us, judge_us = delay(mine, way), delay(judge, way)
        allowed = 25 + math.hypot(mine_us.half, judge_us.half)
        said = f"20 vehicles, mean delay {way}: {mine_us.text(1)} µs, ns-3 {judge_us.text(1)}: {alone_us} µs apart, allowed ± {allowed:.1f}"
        print(said)
        assert abs(mine_us.mean - judge_us.mean - alone_us) <= allowed, said


def table(ours, ns3):
    print("| 54/24 Mbit/s | | Tether | ns-3 3.37 |\n|-|-|-|-|")

    def row(name, what, mine, judge):
        print(f"| {name} | {what} | {mine} | {judge} |", flush=True)

    for stations in (2, 5, 10, 20):
        options = (f"--stations={stations}",)
        judge = samples(ns3, 6, 1, *options)
        row(f"{stations} saturated stations", "frames/s", rate(samples(ours, 10, 3, *options), 3).text(0), rate(judge, 1).text(0))
    for vehicles, seeds in ((20, 20), (100, 3), (150, 2), (175, 2), (200, 2)):
        options = (f"--stations={vehicles}", *LOOP)
        mine, judge = samples(ours, 10, 4, *options), samples(ns3, seeds, 1, *options)
        for way, name in (("up", "poses"), ("down", "commands")):
            row(f"{vehicles} vehicles", f"{name} delivered", share(mine, way).text(3), share(judge, way).text(3))
            row("", f"{name}, mean delay, ms", Mean([r[way]["mean_us"] / 1000 for r in mine]).text(3),
                Mean([r[way]["mean_us"] / 1000 for r in judge]).text(3))
            row("", f"{name}, 95 % below, ms", Mean([r[way]["p95_us"] / 1000 for r in mine]).text(3),
                Mean([r[way]["p95_us"] / 1000 for r in judge]).text(3))
    for name, options in (("2 stations that do not hear each other", ("--hidden=true",)), ("the same with RTS", ("--hidden=true", "--rts=true")),
                          ("2 stations with RTS", ("--rts=true",))):
        row(name, "frames/s", "not modelled", rate(samples(ns3, 6, 1, "--stations=2", *options), 1).text(0))
    for manager in ("minstrel", "aarf"):
        judge = samples(ns3, 6, 1, "--stations=20", f"--manager={manager}", *LOOP)
        row(f"20 vehicles, {manager}", "commands delivered", "not modelled", share(judge, "down").text(3))
        row("", "mean delay, ms", "not modelled", Mean([r["down"]["mean_us"] / 1000 for r in judge]).text(3))


def main():
    ours, ns3 = (Path(sys.argv[1]) / name for name in ("shared_medium_cell", "ns3_wifi_cell"))
    if not ns3.exists():
        sys.exit(f"{ns3} was not built: apt install libns3-dev, then configure and build again")
    if "--all" in sys.argv:
        return table(ours, ns3)
    for test in (saturated_throughput_is_ns3s, one_vehicles_delays_differ_by_what_the_standard_says,
                 twenty_vehicles_lose_nothing_and_wait_as_in_ns3_but_for_that):
        test(ours, ns3)
        print(f"passed: {test.__name__}", flush=True)


main()
