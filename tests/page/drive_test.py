#!/usr/bin/env -S python3 -B
"""Manual driving through `tether view`, in a live run without a controller: the vehicle moves, stops when
the page falls silent, and does not drive where a controller does. Usage: drive_test.py BIN_DIR"""

import json
import pathlib
import signal
import struct
import sys
import time

TESTS = pathlib.Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS / "live"), str(TESTS / "view")]

from live_support import PAPER, check, main, wait_until  # noqa: E402
from view_client import BINARY, Client, address_of, frame, http  # noqa: E402

TOPIC = "CTRL/CMD_VEL"


def publish(client, **fields):
    client.raw.sendall(frame(BINARY, struct.pack("<BI", 1, 1) + json.dumps(fields).encode()))


def advertise(client):
    client.send(op="advertise", channels=[{"id": 1, "topic": TOPIC, "encoding": "json", "schemaName": "tether.twist_t"}])


def a_run(test, *more):
    live = test.start("tether", "live", PAPER, "--set=sensor.rate_hz=20", *more, "--view", "--port=0", "--json")
    address = address_of(live)
    wait_until(10, lambda: test.network.messages("SIM/TRUTH"), "a simulator")
    return live, address


def drives_and_stops_when_the_hand_falls_silent(test):
    live, address = a_run(test, "--set=controller.external=true")
    client, other = Client(address), Client(address)
    advertise(client)
    advertise(other)
    until = time.time() + 2.0
    while time.time() < until:
        publish(client, v_mps=1.0, omega_radps=0.2)
        client.read(0.05)
    publish(other, v_mps=-1.0, omega_radps=0.0)
    other.wait(2, lambda: other.status, "the refusal of a second driver")
    check("another client is driving" in other.status[0]["message"], other.status)
    moved = test.network.messages("SIM/TRUTH")[-1]
    check(moved.v_mps > 0.8 and moved.omega_radps > 0.1, f"it drives: {moved.v_mps} m/s, {moved.omega_radps} rad/s")
    twist = test.network.messages("AGV/CMD_VEL")[-1]
    check(0 <= moved.utime - twist.utime < 500_000, f"the twist is of {twist.utime} us, now it is {moved.utime}")
    check(twist.pose_utime > 0 and twist.run == test.network.messages("SIM/CLOCK")[-1].run, "of this run, after a pose")
    client.close()  # the policy is to hold the last twist
    wait_until(3, lambda: abs(test.network.messages("SIM/TRUTH")[-1].v_mps) < 0.01, "the vehicle stands")
    time.sleep(1.5)
    since = time.time()
    time.sleep(0.5)
    check(not test.network.messages(TOPIC, since=since), "then nothing more is sent")
    live.kill(signal.SIGINT)
    live.wait(10)
    summary = json.loads(live.out())
    check(summary["valid"], f"the run is valid: {summary.get('invalid_because')}")


def does_not_drive_beside_a_controller(test):
    live, address = a_run(test)
    status, _, body = http(address, "/api/run.json")
    check(status == 200 and json.loads(body)["publishable"] == ["CAN/REQUEST"], "only CAN/REQUEST can be published")
    client = Client(address)
    advertise(client)
    publish(client, v_mps=5.0, omega_radps=0.0)
    client.wait(2, lambda: client.status, "the refusal")
    live.kill(signal.SIGINT)
    check(live.wait(10) == 0, live.err())


main(drives_and_stops_when_the_hand_falls_silent, does_not_drive_beside_a_controller)
