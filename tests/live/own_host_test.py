#!/usr/bin/env -S python3 -B
"""LCM with ttl=0 is this host's own: whatever happens to its radio and its routes, programs hear each other, and
they hear nothing that another host sends. The radio is one end of a veth; a neighbour has the other, in a network
namespace of its own. Usage: own_host_test.py BIN_DIR"""

import pathlib
import shutil
import socket
import struct
import subprocess
import sys
import time

sys.path.insert(1, str(pathlib.Path(__file__).resolve().parents[1] / "live"))
from live_support import GROUP, POSE, PORT, SHORT_MAGIC, SOURCE, PAPER, Network, check, main, wait_until

VEHICLE, NEIGHBOUR = "192.0.2.7", "192.0.2.9"
CHANNEL = "NEIGHBOUR"
SENDER = f"""
import socket, struct, time
out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)
datagram = struct.pack(">II", {SHORT_MAGIC}, 0) + b"{CHANNEL}\\0" + bytes(40)
while True:
    for address in ("{GROUP}", "{VEHICLE}"):
        try:
            out.sendto(datagram, (address, {PORT}))
        except OSError:
            pass  # while the radio is down
    time.sleep(0.005)
"""


def ip(*words, **options):
    return subprocess.run(["ip", *words], check=True, capture_output=True, text=True, **options).stdout


class Vehicle:
    """This network with a radio by which everything leaves, and a neighbour who sends all the time."""

    def __init__(self, test):
        self.test = test
        ip("route", "del", "224.0.0.0/4", "dev", "lo")
        neighbour = test.start(shutil.which("unshare"), "--net", "sleep", "1000")
        wait_until(5, lambda: self._is_apart(neighbour.pid), "the neighbour's network")
        ip("link", "add", "wlan0", "type", "veth", "peer", "name", "wlan9", "netns", str(neighbour.pid))
        ip("address", "add", f"{VEHICLE}/24", "dev", "wlan0")
        self.radio("up")
        self._there = ["nsenter", "--target", str(neighbour.pid), "--net"]
        for words in (("address", "add", f"{NEIGHBOUR}/24", "dev", "wlan9"), ("link", "set", "wlan9", "up"),
                      ("route", "add", "default", "via", VEHICLE)):
            subprocess.run([*self._there, "ip", *words], check=True)
        self.neighbour = test.start(shutil.which("nsenter"), *self._there[1:], sys.executable, "-ISc", SENDER)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.neighbour.kill()
        ip("link", "del", "wlan0")
        for route in ip("route", "show").splitlines():
            ip("route", "del", *route.split())
        ip("route", "add", "224.0.0.0/4", "dev", "lo")

    @staticmethod
    def _is_apart(pid):
        own, other = (pathlib.Path(f"/proc/{who}/ns/net").readlink() for who in ("self", pid))
        return own != other

    def radio(self, state):
        ip("link", "set", "wlan0", state)
        if state == "up":
            ip("route", "replace", "default", "via", NEIGHBOUR)

    def record(self, during, expect_all=True):
        """A simulator that sends and a recorder that listens while during() runs: channel -> messages."""
        folder = self.test.work / f"log{time.monotonic_ns()}"
        folder.mkdir()
        recorder = self.test.start("tether-vehicle", "record", folder, "--keep-free-mb", 0)
        wait_until(5, lambda: list(folder.iterdir()), "it records")
        echo = self.test.start("tether-vehicle", "echo", "--quiet")
        time.sleep(0.3)
        simulator = self.test.start("tether-sim", PAPER, "--set", "sensor.rate_hz=100")
        time.sleep(1.5)
        during()
        simulator.kill(15)
        check(simulator.wait(10) == 0, simulator.err())
        time.sleep(0.2)
        for program in (recorder, echo):
            program.kill(15)
            check(program.wait(10) == 0, program.out() + program.err())
        self.ignored = echo.out()
        return read_logs(folder)


def read_logs(folder):
    """Channel -> data of the messages of all logs, by the format's own description."""
    heard = {}
    for file in sorted(folder.iterdir()):
        data = file.read_bytes()
        at = 0
        while at < len(data):
            magic, _, _, channel, size = struct.unpack_from(">IqqII", data, at)
            check(magic == 0xEDA1DA01, f"{file}: no record at {at}")
            at += 28
            heard.setdefault(data[at : at + channel].decode(), []).append(data[at + channel : at + channel + size])
            at += channel + size
    return heard


def check_all_local_and_no_other(test, heard, what):
    poses = [POSE.decode(data).seq for data in heard.get("AGV/POSE", [])]
    check(len(poses) > 100, f"{what}: {len(poses)} poses")
    missing = poses[-1] - poses[0] + 1 - len(poses)
    check(missing == 0, f"{what}: {missing} of {len(poses) + missing} poses are missing")
    others = len(heard.get(CHANNEL, []))
    check(others == 0, f"{what}: {others} messages of the neighbour's were heard")
    test.say(f"{what}: {len(poses)} of {len(poses)} local messages, 0 of the neighbour's")


def radio_down_and_up(vehicle):
    vehicle.radio("down")
    time.sleep(0.5)
    estop = vehicle.test.start("tether-vehicle", "can", "estop")  # repeated: there is no bridge
    time.sleep(1.0)
    estop.kill()
    vehicle.radio("up")
    time.sleep(1.0)


def with_the_route_over_loopback(test):
    with Vehicle(test) as vehicle:
        said = test.run("tether-vehicle", "lcm-route").out()
        check(said == f"{GROUP} is reached by lo\n", said)
        check(f"{GROUP} dev lo" in ip("route", "show") and "src 127.0.0.1" in ip("route", "show"), ip("route", "show"))
        heard = vehicle.record(lambda: radio_down_and_up(vehicle))
        check_all_local_and_no_other(test, heard, "radio down and up")
        check("datagrams_of_other_hosts" not in vehicle.ignored, vehicle.ignored)
        check(len(heard["CAN/REQUEST"]) > 0, "no e-stop was heard")
        test.run("tether-vehicle", "lcm-route", "--remove")
        check(GROUP not in ip("route", "show"), ip("route", "show"))


def without_that_route(test):
    """The group leaves by the radio, while there is one."""
    with Vehicle(test) as vehicle:
        doctor = test.run("tether-vehicle", "doctor").out()
        check(f"note   multicast   {GROUP} is reached by {VEHICLE}, wlan0: LCM's own programs go deaf" in doctor, doctor)
        heard = vehicle.record(lambda: radio_down_and_up(vehicle))
        check_all_local_and_no_other(test, heard, "no route over loopback, radio down and up")
        check(len(heard["CAN/REQUEST"]) > 0, "no e-stop was heard")
        check("network.datagrams_of_other_hosts = " in vehicle.ignored, vehicle.ignored)


def without_any_route(test):
    with Vehicle(test) as vehicle:
        vehicle.radio("down")
        check_all_local_and_no_other(test, vehicle.record(lambda: time.sleep(1.0)), "no route at all")


def from_two_hosts_if_the_url_says_so(test):
    with Vehicle(test) as vehicle:
        echo = test.run("tether-vehicle", "echo", CHANNEL, "--lcm-url", f"udpm://{GROUP}:{PORT}?ttl=1", "--quiet",
                        "--duration", 1)
        check(f"{CHANNEL} " in echo.out(), echo.out() + echo.err())
        refused = test.run("tether-vehicle", "lcm-route", "--lcm-url", f"udpm://{GROUP}:{PORT}?ttl=1")
        check(refused.process.returncode == 2 and "spans several hosts" in refused.err(), refused.err())


def lcm_itself_behind_the_firewall(test):
    """A socket as LCM's own, which takes what comes: with tether.nft nothing comes from the neighbour."""
    test.network.close()
    with Vehicle(test) as vehicle:
        test.run("tether-vehicle", "lcm-route")
        counts = {}
        for state in ("open", "closed"):
            if state == "closed":
                subprocess.run(["nft", "--file", SOURCE / "systemd/tether.nft"], check=True)
            listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(("", PORT))
            listener.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP,
                                struct.pack("4s4s", socket.inet_aton(GROUP), socket.inet_aton(VEHICLE)))
            listener.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP,
                                struct.pack("4s4s", socket.inet_aton(GROUP), socket.inet_aton("127.0.0.1")))
            listener.settimeout(0.2)
            simulator = test.start("tether-sim", PAPER, "--set", "sensor.rate_hz=100")
            counts[state] = {True: 0, False: 0}
            end = time.monotonic() + 2
            while time.monotonic() < end:
                try:
                    counts[state][CHANNEL.encode() in listener.recv(65536)] += 1
                except TimeoutError:
                    pass
            listener.close()
            simulator.kill()
        check(counts["open"][True] > 100 and counts["closed"][True] == 0, counts)
        check(min(both[False] for both in counts.values()) > 100, counts)
        subprocess.run(["nft", "delete", "table", "inet", "tether"], check=True)
        test.say(f"LCM's socket, without and with tether.nft: {counts['open'][True]} and 0 of the neighbour's")
    test.network = Network()


main(
    with_the_route_over_loopback,
    without_that_route,
    without_any_route,
    from_two_hosts_if_the_url_says_so,
    lcm_itself_behind_the_firewall,
)
