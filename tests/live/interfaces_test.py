#!/usr/bin/env -S python3 -B
"""LCM on hosts with a second interface: what we send goes where the receivers listen, which is where
the route to the group leads. Changes the network that it runs in.
Usage: interfaces_test.py BIN_DIR"""

import os
import subprocess

from live_support import GROUP, PAPER, SOURCE, check, main

SHORT = ("--set", "run.duration_s=3", "--set", "sensor.rate_hz=20")


def ip(*arguments):
    subprocess.run(("ip", *arguments), check=True)


def give_interface(*addresses):
    """A new eth0 in place of any that is there, and no multicast route."""
    subprocess.run(("ip", "link", "del", "eth0"), stderr=subprocess.DEVNULL, check=False)
    subprocess.run(("ip", "route", "del", "224.0.0.0/4"), stderr=subprocess.DEVNULL, check=False)
    subprocess.run(("ip", "route", "del", f"{GROUP}/32"), stderr=subprocess.DEVNULL, check=False)
    ip("link", "add", "eth0", "type", "veth", "peer", "name", "other_end")
    for address in addresses:
        ip("address", "add", address, "dev", "eth0")
    ip("link", "set", "eth0", "up")
    ip("link", "set", "other_end", "up")


def lockstep_runs(test, name):
    out = ("--out", test.work / name)
    run = test.run("tether", "run", PAPER, *SHORT, "--processes", *out, seconds=60)
    check(run.process.returncode == 0, f"{name}: {run.err()}")


def live_runs(test, name):
    run = test.run("tether", "live", PAPER, *SHORT, "--out", test.work / name, seconds=30)
    check(run.process.returncode == 0, f"{name}: {run.err()}")
    check("PRR 1.000" in run.out() + run.err(), f"{name}: {run.out()}{run.err()}")


def buses_talk(test, name):
    """Ours among each other and with LCM, and a bus does not hear itself."""
    tests = test.bin.parent / "tests" / "lcm_bus_test"
    some = ("Hears*", "IsHeard*", "Messages*", "NeverHears*")
    run = test.run(tests, "--gtest_filter=" + ":".join(f"UdpmBusTest.{s}" for s in some), seconds=60)
    check(run.process.returncode == 0, f"{name}: {run.out()}")


def all_talk(test, name):
    buses_talk(test, name)
    lockstep_runs(test, f"lockstep {name}")
    test.say(name)


def the_documented_route_keeps_traffic_on_loopback(test):
    give_interface("10.1.2.3/24")
    ip("route", "add", f"{GROUP}/32", "dev", "lo")
    all_talk(test, "route to loopback")
    live_runs(test, "live")


def a_default_route_beside_it_changes_nothing(test):
    give_interface("10.1.2.3/24")
    ip("route", "add", "default", "via", "10.1.2.1")
    ip("route", "add", f"{GROUP}/32", "dev", "lo")
    all_talk(test, "both routes")


def a_default_route_alone_suffices(test):
    give_interface("10.1.2.3/24")
    ip("route", "add", "default", "via", "10.1.2.1")
    all_talk(test, "default route")


def two_addresses_are_one_host(test):
    give_interface("10.1.2.3/24", "10.7.7.7/16")
    ip("route", "add", "default", "via", "10.1.2.1")
    all_talk(test, "two addresses")
    ip("route", "add", f"{GROUP}/32", "dev", "lo", "src", "10.7.7.7")
    all_talk(test, "two addresses, route to loopback from the second")


def no_route_is_needed_by_what_stays_on_this_host(test):
    """With ttl=0 and an external controller in Python, too; with ttl=1 the error says which command is missing."""
    give_interface()
    lockstep_runs(test, "lockstep without a route")
    live_runs(test, "live without a route")
    law = test.work / "law.py"
    law.write_text("import tether\ntether.main(lambda t, pose, path: (0.5, 0.1))\n")
    command = f"python3 -B {law} --url {{url}} --scenario {{scenario}}"
    run = test.run("tether", "run", PAPER, *SHORT, "--set", f'controller.command="{command}"', seconds=60,
                   env=os.environ | {"PYTHONPATH": str(SOURCE / "python")})
    check(run.process.returncode == 0 and "downlink" in run.out(), run.err())
    wide = ("--lcm-url", f"udpm://{GROUP}:7667?ttl=1")
    for options in (("--processes",), ("--set", "controller.external=true")):
        run = test.run("tether", "run", PAPER, *SHORT, *options, *wide, seconds=60)
        check(run.process.returncode == 1 and f"ip route add {GROUP}/32 dev lo" in run.err(), run.err())


main(
    the_documented_route_keeps_traffic_on_loopback,
    a_default_route_beside_it_changes_nothing,
    a_default_route_alone_suffices,
    two_addresses_are_one_host,
    no_route_is_needed_by_what_stays_on_this_host,
)
