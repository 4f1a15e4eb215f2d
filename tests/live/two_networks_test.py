#!/usr/bin/env -S python3 -B
"""The relay joins two LCM networks: the controller's side gets what passes the link, and nothing
else of the vehicle's side. Usage: two_networks_test.py BIN_DIR"""

import time

from live_support import PAPER, Network, POSE, TWIST, check, main, wait_for_loop

CONTROL_PORT = 7668


def relay_joins_two_networks(test):
    vehicle_side = test.network
    control_side = Network(CONTROL_PORT)
    start = f"--start-utime={int(time.time() * 1e6) + 1_000_000}"
    common = (PAPER, start, "--set=sensor.rate_hz=20", "--set=channel.uplink.prr=0.7")
    nodes = [
        test.start("tether-sim", *common),
        test.start("tether-netem", *common, f"--control-lcm-url={control_side.url}"),
        test.start("tether-controller", *common, f"--lcm-url={control_side.url}"),
    ]
    wait_for_loop(vehicle_side)
    time.sleep(4.0)
    for node in nodes:
        check(node.running(), f"{node.name} ended")

    for network, name, has in (
        (
            vehicle_side,
            "vehicle's",
            {"AGV/POSE", "AGV/CMD_VEL", "SIM/CLOCK", "SIM/TRUTH", "SIM/COUNTERS"}
            | {"NET/UPLINK", "NET/DOWNLINK", "NET/COUNTERS"},
        ),
        (
            control_side,
            "controller's",
            {"CTRL/POSE", "CTRL/CMD_VEL", "CTRL/REPORT", "CTRL/COUNTERS"}
            | {"NET/UPLINK", "NET/DOWNLINK", "SIM/CLOCK"},
        ),
    ):
        test.say(f"{name} side: {' '.join(sorted(network.channels()))}")
        check(network.channels() == has, f"the {name} side should have {sorted(has)}")

    offered = len(vehicle_side.messages("AGV/POSE"))
    passed = [m.seq for m in control_side.messages("CTRL/POSE")]
    sent = {m.seq: (m.x_m, m.y_m, m.yaw_rad) for m in vehicle_side.messages("AGV/POSE")}
    for m in control_side.messages("CTRL/POSE"):
        check(sent[m.seq] == (m.x_m, m.y_m, m.yaw_rad), f"pose {m.seq} changed on its way")
    ratio = len(passed) / offered
    commands = len(vehicle_side.messages("AGV/CMD_VEL"))
    test.say(f"{offered} poses, {len(passed)} passed ({ratio:.2f}), {commands} commands came back")
    check(0.5 < ratio < 0.9, f"{ratio} of the poses passed, PRR is 0.7")
    check(abs(commands - len(passed)) <= 1, "not one command per pose")
    truth = vehicle_side.last("SIM/TRUTH")
    check(truth.v_mps > 0.3, f"the vehicle stands: {truth.v_mps} m/s")

    # LCM 1.3.1 separates networks by port: what is sent on one is not heard on the other.
    control_side.send("AGV/CMD_VEL", TWIST.encode(utime=truth.utime + 500_000, seq=10**6))
    control_side.send("AGV/POSE", POSE.encode(utime=truth.utime, seq=10**6))
    time.sleep(0.5)
    seqs = [m.seq for m in vehicle_side.messages("AGV/CMD_VEL")]
    check(10**6 not in seqs, "a message crossed without the relay")
    control_side.close()


main(relay_joins_two_networks)
