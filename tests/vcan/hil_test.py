#!/usr/bin/env python3
"""Hardware in the loop: `tether live scenarios/hil_vcan.toml` drives the path through SocketCAN,
as well as the same controller does without CAN; with plans, through a network that would stop it."""

import json
import os

from can_support import Candump, integer, live_support
from live_support import SOURCE, check

SCENARIO = str(SOURCE / "scenarios" / "hil_vcan.toml")
# User-Mode Linux takes 30 us for a system call, too long for six processes in real time: there,
# slow motion, and the first turns only.
NATIVE = os.environ.get("TETHER_CAN_KERNEL") == "native"
SPEED, DURATION_S = (1.0, 62) if NATIVE else (0.5, 20)
LENGTH = f"--set=run.duration_s={DURATION_S}"


def run_json(test, *arguments, seconds):
    done = test.run("tether", *arguments, "--json", seconds=seconds)
    check(done.process.returncode == 0, f"exit code {done.process.returncode}")
    return json.loads(done.out())


def the_error_is_that_of_the_direct_run_and_odometry_that_of_the_truth(test):
    test.network.close()  # to hear all of it costs more than to drive
    direct = run_json(test, "run", SCENARIO, "--set=vehicle.drivetrain=direct", LENGTH, seconds=60)
    record = Candump(test, "hil")
    live = run_json(test, "live", SCENARIO, f"--speed={SPEED}", LENGTH, seconds=200)
    frames = {0x201: [], 0x202: [], 0x77F: []}
    for line in record.stop().read_text().splitlines():
        identifier, _, data = line.split()[2].partition("#")
        if len(identifier) == 3 and int(identifier, 16) in frames:
            frames[int(identifier, 16)].append(bytes.fromhex(data))
    drives = live["drivetrain"]
    ratio = live["epsilon_m"] / direct["epsilon_m"]
    test.say(
        f"measured: error {live['epsilon_m']:.3f} m over CAN, {direct['epsilon_m']:.3f} m direct; "
        f"odometry {drives['odometry_distance_m']:.2f} m of {drives['true_distance_m']:.2f} m"
    )
    check(live["node_restarts"] == 0, f"{live['node_restarts']} nodes died")
    check(drives["disarms"] == 0, f"stopped: {drives['stop_reason']}")
    check(direct["epsilon_m"] > 1.0, "the direct run did not drive")
    check(abs(ratio - 1.0) <= 0.03, f"the errors' ratio is {ratio:.4f}")
    distance_ratio = drives["odometry_distance_m"] / drives["true_distance_m"]
    check(drives["true_distance_m"] > 1.5 * DURATION_S, "the vehicle did not drive")
    check(abs(distance_ratio - 1.0) <= 0.01, f"odometry's ratio is {distance_ratio:.4f}")
    # It went over the wire: both wheels got speeds, one of them mounted the other way round.
    for node, sign in ((1, 1), (2, -1)):
        setpoints = frames[0x200 + node]
        check(len(setpoints) > 40 * DURATION_S, f"{len(setpoints)} setpoints for node {node}")
        fastest = max(sign * integer(data, 2) for data in setpoints)
        check(fastest > 12000 * 2.0 / (2 * 3.1416 * 0.4), f"node {node} got at most {fastest}")
    check(len(frames[0x77F]) > 12 * DURATION_S, f"{len(frames[0x77F])} heartbeats of the bridge")


def plans_that_the_bridge_executes_outlive_loss_and_delay(test):
    test.network.close()
    settings = {
        "controller.law": "predictive_consistent",
        "controller.trigger": "timer",
        "controller.rate_hz": 10,
        "controller.pose_timeout_s": 0,
        "actuator.policy": "horizon",
        "can.max_blind_s": 10,
        "can.max_blind_m": 10,
        "channel.prr": 0.5,
        "channel.delay_ms": 150,
        "run.duration_s": 6,
    }
    arguments = [SCENARIO] + [f"--set={key}={value}" for key, value in settings.items()]
    twists = ["--set=controller.law=pid", "--set=actuator.policy=zero"]
    stopped = run_json(test, "run", *arguments, *twists, seconds=60)
    simulated = run_json(test, "run", *arguments, seconds=60)
    live = run_json(test, "live", *arguments, f"--speed={SPEED}", seconds=200)
    test.say(
        f"measured: error {live['epsilon_m']:.3f} m over CAN, {simulated['epsilon_m']:.3f} m in "
        f"virtual time, with twists {stopped['epsilon_m']:.3f} m"
    )
    check(stopped["epsilon_m"] > 5.0, "twists would have done as well")
    check(live["node_restarts"] == 0, f"{live['node_restarts']} nodes died")
    check(live["drivetrain"]["disarms"] == 0, f"stopped: {live['drivetrain']['stop_reason']}")
    check(live["epsilon_m"] < 1.0, "the vehicle did not follow the path")


def a_run_whose_drives_are_never_armed_is_invalid(test):
    test.network.close()
    done = test.run("tether", "live", SCENARIO, "--set=can.arm=never", "--duration=4", "--json", seconds=60)
    check(done.process.returncode == 1, f"exit code {done.process.returncode}")
    why = json.loads(done.out())["invalid_because"]
    check(any("never armed: disarmed: " in finding for finding in why), f"{why}")


if __name__ == "__main__":
    live_support.main(
        the_error_is_that_of_the_direct_run_and_odometry_that_of_the_truth,
        plans_that_the_bridge_executes_outlive_loss_and_delay,
        a_run_whose_drives_are_never_armed_is_invalid,
    )
