#!/usr/bin/env -S python3 -B
"""ROS 2 nodes on the other side of tether-ros2, in miniature on Fast DDS (fast_dds_peer): poses reach them and their
commands reach the vehicle. Usage: peers_test.py BIN_DIR"""

import pathlib
import re
import signal
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "live"))

from live_support import PAPER, check, main, wait_until  # noqa: E402

ROS2 = ["--set=controller.ros2=true", "--set=sensor.rate_hz=20"]
COUNTERS = "CTRL/COUNTERS"


def peer(test, domain, *arguments):
    return test.start("../tests/fast_dds_peer", str(domain), *[str(a) for a in arguments])


def messages(program):
    """Number and last size of the messages that a peer has heard."""
    check(program.wait(40) == 0, program.err())
    found = re.match(r"(\d+) messages, (\d+) bytes", program.out())
    return int(found[1]), int(found[2])


class Run:
    """Simulator, relay and door."""

    def __init__(self, test, domain, *more):
        settings = [PAPER, *ROS2, f"--set=ros2.domain={domain}", *more]
        self.programs = [test.start(name, *settings) for name in ("tether-sim", "tether-netem", "tether-ros2")]
        self.door = self.programs[-1]

    def end(self):
        for program in self.programs:
            program.kill(signal.SIGINT)
        for program in self.programs:
            check(program.wait(30) == 0, program.err())


def door_runs(test):
    wait_until(30, lambda: "ros2.accepted" in test.network.counters(COUNTERS), "counters of tether-ros2")


def counter(test, name):
    return test.network.counters(COUNTERS).get(f"ros2.{name}", 0)


def counts(test, name, seconds=20):
    wait_until(seconds, lambda: counter(test, name) > 0, f"ros2.{name}: {test.network.counters(COUNTERS)}")


def a_driver_drives_through_the_network_and_two_are_refused(test):
    run = Run(test, 3)
    door_runs(test)
    # Another domain's driver is not heard.
    peer(test, 4, "drive", "twist", 60)
    listener = peer(test, 3, "listen", "/tf", "tf2_msgs/msg/TFMessage", 8)
    time.sleep(2)
    check(counter(test, "accepted") == 0, "a command of another domain was accepted")
    stamped = peer(test, 3, "drive", "stamped", 60)
    counts(test, "accepted")
    wait_until(10, lambda: (m := test.network.last("AGV/CMD_VEL")) and m.v_mps == 0.5, "the command on the vehicle")
    count, size = messages(listener)
    check(count > 40 and size == 188, f"/tf: {count} messages of {size} bytes")
    # Killed and back, as another publisher with the other type.
    stamped.kill()
    time.sleep(2.5)
    first = counter(test, "accepted")
    twist = peer(test, 3, "drive", "twist", 60, "best_effort")
    wait_until(15, lambda: counter(test, "accepted") > first + 10, "commands of the next driver")
    check(counter(test, "several") == 0, "a restart was taken for two publishers")
    second = peer(test, 3, "drive", "stamped", 60)
    counts(test, "several")
    wait_until(10, lambda: "several publishers send" in run.door.err(), "the line that names a publisher")
    wait_until(5, lambda: time.time() - test.network.last("CTRL/CMD_VEL").arrival > 0.5, "neither drives")
    for program in (twist, second):
        program.kill()
    run.end()


def commands_that_no_vehicle_shall_follow_are_counted(test):
    run = Run(test, 5)
    door_runs(test)
    for name, arguments in {
        "non_finite": ["twist", 60, "v=nan"],
        "wrong_frame": ["stamped", 60, "frame=odom"],
        "old": ["stamped", 60, "age_ms=3000"],
    }.items():
        driver = peer(test, 5, "drive", *arguments)
        counts(test, name)
        driver.kill()
        time.sleep(2.5)
    check(counter(test, "accepted") == 0, test.network.counters(COUNTERS))
    check(not test.network.messages("CTRL/CMD_VEL"), "a refused command went on")
    run.end()


main(
    a_driver_drives_through_the_network_and_two_are_refused,
    commands_that_no_vehicle_shall_follow_are_counted,
)
