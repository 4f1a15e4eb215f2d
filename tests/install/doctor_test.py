#!/usr/bin/env -S python3 -B
"""tether doctor, on machines that lack what it looks for. Usage: doctor_test.py BIN_DIR"""

import pathlib
import re
import socket
import subprocess
import sys

sys.path.insert(1, str(pathlib.Path(__file__).resolve().parents[1] / "live"))
from live_support import GROUP, PORT, check, main


def doctor(test, expect, *arguments):
    program = test.run(test.bin / "tether", "doctor", *arguments, seconds=10)
    code = program.wait(0)
    check(code == expect, f"exit code {code}:\n{program.out()}{program.err()}")
    return program.out()


def route(change):
    subprocess.run(["ip", "route", change, "224.0.0.0/4", "dev", "lo"], check=True)


def hears_itself_where_there_is_a_route(test):
    said = doctor(test, 0)
    check(f"{GROUP} is reached by" in said and f"heard again on udpm://{GROUP}:{PORT}" in said, said)
    test.say(said.splitlines()[1])


def says_what_to_do_where_there_is_none(test):
    route("del")
    try:
        said = doctor(test, 1)
    finally:
        route("add")
    check("Network is unreachable" in said and f"ip route add {GROUP}/32 dev lo" in said, said)
    test.say(said.splitlines()[0])


def names_a_port_that_another_program_holds_exclusively(test):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as selfish:
        selfish.bind(("", 0))
        port = selfish.getsockname()[1]
        said = doctor(test, 1, "--lcm-url", f"udpm://{GROUP}:{port}")
    check("Address already in use" in said and f"'sport = {port}'" in said, said)


def knows_a_can_interface_from_others(test):
    check("no interface can7" in doctor(test, 1, "--can", "can7"), "can7 is missed")
    check("lo is no CAN interface" in doctor(test, 1, "--can", "lo"), "lo is not CAN")


def measures_latency_under_load(test):
    program = test.run(test.bin / "tether-vehicle", "doctor", "--realtime", "--seconds", 2, seconds=15)
    said = program.out() + program.err()
    measured = re.search(r"latency +worst ([\d.]+) ms, 99.9 % below ([\d.]+) ms, of (\d+) wake-ups in 2 s under load", said)
    check(measured and 0 < float(measured[2]) <= float(measured[1]) and 10 < int(measured[3]) <= 2000, said)
    refused = test.run(test.bin / "tether-vehicle", "doctor", "--seconds", 2)
    check(refused.process.returncode == 2 and "--realtime" in refused.err(), refused.err())
    test.say(measured[0])


main(
    hears_itself_where_there_is_a_route,
    says_what_to_do_where_there_is_none,
    names_a_port_that_another_program_holds_exclusively,
    knows_a_can_interface_from_others,
    measures_latency_under_load,
)
