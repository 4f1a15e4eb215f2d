#!/usr/bin/env -S python3 -B
"""A shared medium in wall time: its delays, what it loses, and what its counters say of that.
Usage: medium_test.py BIN_DIR"""

import json
import signal

from live_support import PAPER, check, main, wait_until


def started(test, *settings, poses):
    """When so many have come up."""
    live = test.start("tether", "live", PAPER, *(f"--set={setting}" for setting in settings))
    wait_until(10, lambda: len(test.network.messages("CTRL/POSE")) >= poses, f"{poses} poses")
    return live


def a_cell_lets_poses_wait_for_their_grants(test):
    started(
        test,
        "sensor.rate_hz=6.3",  # 159 ms: each goes alone, at a phase of its own
        "medium.model=scheduled",
        "medium.request_period_ms=100",
        "medium.offset_ms=50",
        poses=20,
    )
    sent = {m.seq: m.arrival for m in test.network.messages("AGV/POSE")}
    delays_ms = sorted((m.arrival - sent[m.seq]) * 1e3 for m in test.network.messages("CTRL/POSE"))
    test.say(f"{len(delays_ms)} poses, delays {delays_ms[0]:.1f} to {delays_ms[-1]:.1f} ms")
    check(delays_ms[0] > 49, "a pose was there before its grant")
    middle_ms = delays_ms[len(delays_ms) // 2]
    check(60 < middle_ms < 145, f"the median {middle_ms:.1f} ms is not that of waiting for a grant")
    check(delays_ms[-1] - delays_ms[0] > 60, "all wait as long, at whatever phase they come")


def a_crowd_loses_packets_that_are_counted(test):
    live = started(
        test,
        "sensor.rate_hz=20",
        "medium.model=dcf",
        "medium.rate_Mbps=24",
        "medium.others=200",
        "medium.lifetime_ms=100",
        poses=60,
    )
    live.kill(signal.SIGINT)
    live.wait(10)
    check("[medium] is asked for" in live.err(), f"no warning: {live.err()}")
    counters = test.network.counters("NET/COUNTERS")
    medium = {n[7:]: value for n, value in counters.items() if n.startswith("medium.")}
    test.say(f"{medium}")
    check(medium["sent"] > 60, "hardly anything was sent")
    check(medium["lost"] > 10 and medium["collisions"] > 100, "it was no crowd")
    under_way = medium["sent"] - medium["delivered"] - medium["lost"]
    check(0 <= under_way <= 5, f"{under_way} packets under way")
    offered = counters["uplink.offered"] + counters["downlink.offered"]
    check(offered == medium["delivered"], f"links were offered {offered} packets")


def a_fleet_shares_it(test):
    live = test.start("tether", "live", PAPER, "--duration", "4", "--json", *(f"--set={setting}" for setting in (
        "vehicle.plant=kinematic", "fleet.count=5", "sensor.rate_hz=10", "medium.model=dcf")))
    code = live.wait(20)
    check(code == 0, f"exit code {code}: {live.err()}")
    run = json.loads(live.out())
    check(run["valid"] and run["vehicles"] == 5, "not five vehicles")
    each = list(run["each"].values())
    for vehicle in each:
        check(vehicle["uplink"]["delivered"] > 20, f"a vehicle has hardly sent: {vehicle['uplink']}")
    on_air = [{n[13:]: c for n, c in v["counters"].items() if n.startswith("netem.medium.")} for v in each]
    check(on_air[0]["sent"] > 5 * 2 * 20, f"not all of them send over the medium: {on_air[0]}")
    check(not any(on_air[1:]), "what is on the air is counted more than once")


main(
    a_fleet_shares_it,
    a_cell_lets_poses_wait_for_their_grants,
    a_crowd_loses_packets_that_are_counted,
)
