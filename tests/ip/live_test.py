#!/usr/bin/env -S python3 -B
"""Hosts of `tether floor`, with programs that know nothing of Tether: UDP against what the link says, fragments,
iperf3, an MQTT broker, curl; and what is left when tether-tun is killed. Usage: live_test.py BIN_DIR"""

import csv
import json
import math
import os
import pathlib
import signal
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "live"))

from live_support import PAPER, alive, check, main, wait_until  # noqa: E402

SIGMAS = 5.0


class Floor:
    def __init__(self, test, *options):
        self.test = test
        self.folder = test.work / "floor"
        up = test.run("tether-floor", "--floor", self.folder, "up", PAPER, *options)
        check(up.process.returncode == 0, f"up: {up.err()}")
        check("10.67.0.1       control" in up.out() and "10.67.1.1       AGV" in up.out(), f"hosts: {up.out()}")
        self.tun = int((self.folder / "lock").read_text())

    def start(self, host, *command):
        return self.test.start("tether-floor", "--floor", self.folder, "exec", host, "--", *command)

    def run(self, host, *command, seconds=20):
        program = self.start(host, *command)
        program.wait(seconds)
        return program

    def down(self):
        down = self.test.run("tether-floor", "--floor", self.folder, "down")
        check(down.process.returncode == 0, f"down: {down.err()}")
        check(not self.folder.exists(), "the floor's folder is left")
        wait_until(5, lambda: not alive(self.tun), "tether-tun ended")


RECEIVER = """
import socket, struct, sys, time
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
s.bind(("", 5000))
print("ready", flush=True)
while True:
    data = s.recv(65536)
    number, sent = struct.unpack_from("<Iq", data)
    if number == 0xffffffff: break
    print(number, (time.clock_gettime_ns(time.CLOCK_MONOTONIC) - sent) / 1e6, len(data))
"""
SENDER = """
import socket, struct, sys, time
count, pause, size = int(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3])
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
for number in range(count):
    s.sendto(struct.pack("<Iq", number, time.clock_gettime_ns(time.CLOCK_MONOTONIC)).ljust(size, b"x"), ("control", 5000))
    time.sleep(pause)
for _ in range(50):
    time.sleep(0.02)
    s.sendto(struct.pack("<Iq", 0xffffffff, 0), ("control", 5000))
"""


def udp(floor, count, pause, size):
    """(number, delay in ms, size) of each datagram that arrived, in order of arrival."""
    receiver = floor.start("control", sys.executable, "-c", RECEIVER)
    wait_until(10, lambda: "ready" in receiver.out(), "the receiver waits")
    sender = floor.run("AGV", sys.executable, "-c", SENDER, str(count), str(pause), str(size), seconds=60)
    check(sender.process.returncode == 0, sender.err())
    receiver.wait(10)
    rows = [line.split() for line in receiver.out().splitlines()[1:]]
    return [(int(n), float(delay), int(size)) for n, delay, size in rows]


def datagrams_meet_the_link(test):
    """The share that arrives is the PRR, within 5 standard deviations of a binomial; those that arrive are those of the
    record; delays are the link's, and never less."""
    floor = Floor(test, "--set", "channel.prr=0.8", "--set", "channel.uplink.delay_ms=15", "--record", test.work)
    count = 2000
    got = udp(floor, count, 0.001, 200)
    tolerance = SIGMAS * math.sqrt(0.8 * 0.2 / count)
    check(abs(len(got) / count - 0.8) < tolerance, f"{len(got)} of {count} arrived")
    delays = sorted(delay for _, delay, _ in got)
    check(delays[0] >= 14.9, f"the fastest took {delays[0]} ms of 15")
    check(delays[len(delays) // 2] < 60.0,  # the machine is busy
           f"half took more than {delays[len(delays) // 2]} ms of 15")
    check([n for n, _, _ in got] == sorted(n for n, _, _ in got), "a constant delay keeps the order")
    test.say(f"UDP: {len(got)}/{count}, delay p50 {delays[len(delays) // 2]:.3f}, p99 {delays[len(delays) * 99 // 100]:.3f} ms")
    floor.down()
    with open(test.work / "AGV-uplink.csv") as file:
        fates = list(csv.DictReader(file))
    kept = [i for i, row in enumerate(fates[:count]) if row["lost"] == "0"]
    check(kept == [n for n, _, _ in got], "the record names other packets than arrived")
    check(all(row["delay_ms"] == "15.000000" for row in fates if row["lost"] == "0"), "recorded delays")


def large_datagrams_are_fragmented(test):
    """4000 bytes are three packets: all arrive, or the datagram does not."""
    floor = Floor(test, "--set", "channel.prr=0.9")
    count = 1000
    got = udp(floor, count, 0.001, 4000)
    share = 0.9**3
    check({size for _, _, size in got} == {4000}, "a datagram was cut")
    tolerance = SIGMAS * math.sqrt(share * (1 - share) / count)
    check(abs(len(got) / count - share) < tolerance, f"{len(got)} of {count} arrived, not {share:.3f}")
    too_long = floor.run("AGV", sys.executable, "-c", """
import socket
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.setsockopt(socket.IPPROTO_IP, 10, 2)  # IP_MTU_DISCOVER, IP_PMTUDISC_DO
try: s.sendto(bytes(1473), ("control", 5000))
except OSError as error: print(error.errno)
s.sendto(bytes(1472), ("control", 5000))
""")
    check(too_long.out() == "90\n", f"EMSGSIZE: {too_long.out()} {too_long.err()}")
    floor.down()


def foreign_stacks_work(test):
    floor = Floor(test, "--set", "channel.delay_ms=5", "--set", "channel.uplink.rate.bits_per_s=8e6")
    server = floor.start("control", "/usr/bin/iperf3", "-s", "-1", "--forceflush")
    wait_until(10, lambda: "listening" in server.out(), "iperf3 listens")
    client = floor.run("AGV", "/usr/bin/iperf3", "-c", "control", "-t", "4", "-J")
    sent = json.loads(client.out())
    check("error" not in sent, f"iperf3: {sent.get('error')}")
    rate = sent["end"]["sum_received"]["bits_per_second"] / 1e6
    # 1448 of 1500 bytes are data; the rate is the bottleneck's from the slow start on.
    check(5.0 < rate < 8.0 * 1448 / 1500 * 1.02, f"goodput {rate:.2f} Mbit/s through 8 Mbit/s")
    test.say(f"iperf3: {rate:.2f} Mbit/s through 8 Mbit/s")

    (test.work / "mosquitto.conf").write_text("listener 1883 0.0.0.0\nallow_anonymous true\n")
    floor.start("control", "/usr/sbin/mosquitto", "-c", str(test.work / "mosquitto.conf"))
    subscriber = floor.start("control", "/usr/bin/mosquitto_sub", "-h", "AGV-none", "-t", "x")
    subscriber.wait(10)
    check(subscriber.process.returncode != 0, "a host that does not exist was found")
    publish = ("/usr/bin/mosquitto_pub", "-h", "control", "-t", "floor/1", "-m", "hello", "-q", "1", "-r")
    wait_until(20, lambda: floor.run("AGV", *publish).process.returncode == 0, "the broker takes a message")
    # The message is retained: it comes to any subscriber, at any time.
    subscriber = floor.run("AGV", "/usr/bin/mosquitto_sub", "-h", "control", "-t", "floor/#", "-C", "1", "-W", "10")
    check(subscriber.out() == "hello\n", f"MQTT: {subscriber.out()}")

    (test.work / "served").mkdir()
    (test.work / "served/file").write_bytes(os.urandom(100_000))
    floor.start("AGV", sys.executable, "-m", "http.server", "80", "--directory", str(test.work / "served"))
    fetched = floor.run("control", "/usr/bin/curl", "-sf", "--retry", "20", "--retry-connrefused", "--retry-delay", "1",
                        "-o", str(test.work / "fetched"), "http://AGV/file")
    check(fetched.process.returncode == 0, "curl failed")
    check((test.work / "fetched").read_bytes() == (test.work / "served/file").read_bytes(), "curl got another file")
    floor.down()


def nothing_is_left(test):
    """After kill -9 no process of the hosts lives, and `down` and `up` work."""
    floor = Floor(test)
    second = test.run("tether-floor", "--floor", floor.folder, "up", PAPER)
    check(second.process.returncode == 2 and "a floor is up already" in second.err(), f"second: {second.err()}")
    second = test.run("tether-tun", "--floor", floor.folder, PAPER)
    check(second.process.returncode == 2 and "a floor is up already" in second.err(), f"second tun: {second.err()}")
    unknown = floor.run("AGV9", "/bin/true")
    check(unknown.process.returncode == 2 and "control, AGV" in unknown.err(), f"unknown: {unknown.err()}")
    check(floor.run("AGV", "/bin/sh", "-c", "exit 7").process.returncode == 7, "exit codes go through")
    sleeper = floor.start("control", "/bin/sleep", "1000")
    hosts = [int(line.split()[2]) for line in (floor.folder / "state").read_text().splitlines()]
    check(len(hosts) == 2 and all(map(alive, hosts)), "two hosts live")
    wait_until(5, lambda: sleeper.children(), "sleep runs")
    child = next(iter(sleeper.children().values()))
    os.kill(floor.tun, signal.SIGKILL)
    wait_until(5, lambda: not any(map(alive, [*hosts, child, floor.tun])), "the hosts ended with tether-tun")
    refused = floor.run("AGV", "/bin/true")
    check(refused.process.returncode == 2 and "no floor is up" in refused.err(), f"after the end: {refused.err()}")
    floor.down()
    Floor(test).down()
    bad = test.run("tether-floor", "--floor", floor.folder, "up", PAPER, "--set", "channel.prr=2")
    check(bad.process.returncode == 2 and "channel.uplink.prr" in bad.err() + bad.out(), f"bad: {bad.err()}")


def settings_change_while_it_runs(test):
    floor = Floor(test, "--lcm-url", test.network.url)
    change = test.run("tether", "netem", "set", "prr=0")
    check(change.process.returncode == 0, f"set: {change.err()} {change.out()}")
    check(udp_count(floor) == 0, "packets pass a link of PRR 0")
    floor.down()


def udp_count(floor):
    receiver = floor.start("control", sys.executable, "-c", RECEIVER)
    wait_until(10, lambda: "ready" in receiver.out(), "the receiver waits")
    floor.run("AGV", sys.executable, "-c", SENDER, "20", "0.001", "100", seconds=30)
    receiver.kill()
    receiver.wait(5)
    return len(receiver.out().splitlines()) - 1


if __name__ == "__main__":
    main(datagrams_meet_the_link, large_datagrams_are_fragmented, foreign_stacks_work, nothing_is_left,
         settings_change_while_it_runs)
