#!/usr/bin/env -S python3 -B
"""A live run is what it says: alone on its network, one of each program, all of them alive; or it
says what is wrong, is invalid and ends with 1. Usage: company_test.py BIN_DIR"""

import json
import os
import re
import signal
import socket
import struct
import time

from live_support import (
    GROUP, PAPER, PORT, POSE, PRESENCE, SHORT_MAGIC, TWIST, Failure, Network, alive, check, main, wait_for_loop, wait_until,
)

FAST = ("--set=sensor.rate_hz=20",)
NOTICED_S = 1.5  # within a second; half a second for a busy machine


def live(test, *options):
    return test.start("tether", "live", PAPER, *FAST, *options)


def noticed(program, pattern, seconds, began):
    """How long it took until the program wrote a line that matches."""
    wait_until(seconds, lambda: re.search(pattern, program.err(), re.MULTILINE), pattern)
    return time.monotonic() - began


def check_verdict(program, code, first_line):
    got = program.wait(15)
    check(got == code, f"exit code {got}, not {code}: {program.err()}")
    check(program.out().startswith(first_line), f"not '{first_line}': {program.out()}")


def a_second_run_is_refused_and_harms_no_node(test):
    first = live(test, "--duration=5")
    wait_for_loop(test.network)
    second = live(test)
    check(second.wait(5) == 1, "exit code of the second")
    pattern = (
        rf"another run is on udpm://.*: tether live of AGV, process {first.pid} on host \S+\. End "
        r"it, or give this one a network of its own: --lcm-url 'udpm://239.255.76.67:7668\?ttl=0'"
    )
    check(re.search(pattern, second.err()), second.err())
    other = live(test, "--duration=2", "--lcm-url=udpm://239.255.76.67:7668?ttl=0")
    check_verdict(other, 0, "valid ")
    check_verdict(first, 0, "valid     one run on this network, one of each node, all alive\n")


def two_that_start_at_once_are_both_invalid(test):
    both = [live(test, "--duration=3"), live(test, "--duration=3")]
    for one, other in (both, both[::-1]):
        check_verdict(one, 1, "INVALID ")
        pattern = rf"another run is on this network: \S+( live)? of AGV, process \d+ on host"
        check(re.search(pattern, one.out()), one.out())
        check(one.out().count("another run") == 1, f"told more than once: {one.out()}")


def run_of(program):
    """The run id that `tether live` gives its nodes."""
    for pid in program.children().values():
        with open(f"/proc/{pid}/cmdline") as file:
            if found := re.search(r"--start-utime=(\d+)", file.read()):
                return int(found[1])
    raise Failure("no node has --start-utime")


def a_second_of_each_program_is_named(test):
    for name in ("tether-controller", "tether-netem", "tether-sim"):
        run = live(test)
        wait_for_loop(test.network, since=time.time())
        second = test.start(name, PAPER, *FAST, f"--start-utime={run_of(run)}")
        wait_until(5, lambda: ": running, " in second.err(), f"a second {name}")
        pattern = rf"^t = .* s: a second {name} of AGV, process {second.pid} on host "
        took = noticed(run, pattern, NOTICED_S, time.monotonic())
        test.say(f"a second {name} was named after {took:.2f} s")
        run.kill(signal.SIGINT)
        check_verdict(run, 1, "INVALID ")
        second.kill()
        second.wait(2)


def an_unknown_sender_of_commands_is_named(test):
    run = live(test, "--json")
    wait_for_loop(test.network)
    utime = test.network.last("AGV/CMD_VEL").utime
    began = time.monotonic()
    for seq in range(20):
        message = TWIST.encode(utime=utime + 50_000 * seq, seq=seq, run=run_of(run))
        test.network.send("CTRL/CMD_VEL", message)
        time.sleep(0.05)
    pattern = r"several programs send at the same time on CTRL/CMD_VEL: .*port"
    took = noticed(run, pattern, 1.0, began)
    test.say(f"two senders of CTRL/CMD_VEL were named after less than {took:.2f} s")
    run.kill(signal.SIGINT)
    check(run.wait(5) == 1, "exit code")
    summary = json.loads(run.out())
    check(summary["valid"] is False, f"valid: {summary['valid']}")
    check(re.search(pattern, summary["invalid_because"][0]), f"{summary['invalid_because']}")
    refused = summary["counters"]["netem.network.refused"]
    check(refused == 20, f"the relay refused {refused} of 20")
    offered, passed_on = (summary["counters"][f"netem.downlink.{kind}"] for kind in ("offered", "delivered"))
    check(offered == passed_on > 10, f"its controller's commands: {offered} came, {passed_on} were passed on")


def one_datagram_makes_the_run_invalid(test):
    """A single pose or command with the right run number, before the run's own or among them."""
    for channel, kind, early in (("CTRL/POSE", POSE, True), ("AGV/CMD_VEL", TWIST, False)):
        run = live(test, "--duration=3")
        wait_until(5, lambda: "tether-controller" in run.children(), "its controller")
        if not early:
            wait_for_loop(test.network, since=time.time())
        test.network.send(channel, kind.encode(utime=0, seq=7, run=run_of(run)))
        check_verdict(run, 1, "INVALID ")
        check(re.search(rf"an unknown program sent on {channel}: ", run.out()), run.out())


def nodes_do_not_act_on_datagrams_of_an_unknown_program(test):
    """Poses and commands with the run's number, from before the first ones on."""
    run = live(test, "--duration=3", "--json")
    wait_until(5, lambda: "tether-sim" in run.children(), "its nodes")
    number = run_of(run)
    sent = 0
    while run.running() and not test.network.last("SIM/TRUTH"):
        test.network.send("CTRL/POSE", POSE.encode(utime=0, seq=1 << 60, run=number, x_m=9, y_m=9))
        test.network.send("AGV/CMD_VEL", TWIST.encode(utime=0, seq=1 << 60, run=number, v_mps=1))
        sent += 1
        time.sleep(0.02)
    check(run.wait(15) == 1, run.err())
    summary = json.loads(run.out())
    check(any("an unknown program" in why for why in summary["invalid_because"]), run.out())
    counters = summary["counters"]
    for node, stream in (("controller", "controller.pose"), ("sim", "sim.command")):
        refused = counters.get(f"{node}.network.refused", 0)
        check(refused > 0, f"{node} refused nothing of {sent}")
        acted = {k: counters.get(f"{stream}.{k}", 0) for k in ("missed", "restarts", "jumped")}
        check(acted["missed"] < 100 and acted["restarts"] == acted["jumped"] == 0, f"{stream}: {acted}")
        test.say(f"{node} refused {refused} of {2 * sent} datagrams; {acted}")


def a_forged_presence_makes_the_run_invalid(test):
    """From another port than the relay's: by another host's name, by the relay's own host and process, before the relay's
    first presence and after it, and by a program whose name begins like the relay's."""
    host = socket.gethostname()
    second = r"a second tether-netem of AGV, process \d+ on host"
    for early, program, says_host, what in (
        (False, "tether-netem", "elsewhere", second),
        (False, "tether-netem", host, r"which sends from another port"),
        (True, "tether-netem", host, rf"which sends from another port|{second}"),
        (False, "tether-netem-2", "elsewhere", r"an unknown program sent on CTRL/POSE"),
    ):
        run = live(test, "--duration=2")
        wait_until(5, lambda: "tether-netem" in run.children(), "its relay")
        if not early:
            wait_for_loop(test.network, since=time.time())
        number, pid = run_of(run), run.children()["tether-netem"]
        presence = PRESENCE.encode(run=number, program=program, vehicle="AGV", host=says_host, pid=pid)
        test.network.send("RUN/PRESENCE", presence)
        test.network.send("CTRL/POSE", POSE.encode(utime=0, seq=7, run=number, x_m=9))
        check_verdict(run, 1, "INVALID ")
        check(re.search(what, run.out()), f"{program} on {says_host}, early: {early}: {run.out()}")


def a_jump_of_numbers_makes_the_run_invalid(test):
    """Numbers that jump, of a program that claims to be the relay."""
    run = live(test, "--duration=3", "--json")
    wait_for_loop(test.network)
    number = run_of(run)
    presence = PRESENCE.encode(run=number, program="tether-netem", vehicle="AGV", host="elsewhere", pid=1)
    test.network.send("RUN/PRESENCE", presence)
    utime = test.network.last("SIM/TRUTH").utime + 200_000
    test.network.send("CTRL/POSE", POSE.encode(utime=utime, seq=1 << 60, run=number))
    check(run.wait(15) == 1, run.err())
    summary = json.loads(run.out())
    check(summary["counters"]["controller.pose.missed"] < 100, "acted upon")
    check(any("jumped further" in why for why in summary["invalid_because"]), run.out())


def sender_of(channel):
    """Address and port from which the next message on this channel comes."""
    heard = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    heard.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    heard.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(GROUP) + bytes(4))
    heard.settimeout(5)
    with heard:
        heard.bind(("", PORT))
        while True:
            datagram, sender = heard.recvfrom(65536)
            if datagram[8:].startswith(channel.encode() + b"\0"):
                return sender


def a_forged_source_address_makes_the_run_invalid(test):
    """Poses with the relay's own address and port, which nodes cannot tell from the relay's."""
    run = live(test, "--duration=4", "--json")
    wait_for_loop(test.network, since=time.time())
    address, port = sender_of("CTRL/POSE")
    raw = socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_RAW)
    raw.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
    for _ in range(20):
        last = test.network.last("CTRL/POSE")
        pose = POSE.encode(**vars_of(last) | {"utime": last.utime + 20_000, "seq": last.seq + 1, "x_m": 9.0})
        lcm = struct.pack(">II", SHORT_MAGIC, 1) + b"CTRL/POSE\0" + pose
        udp = struct.pack(">HHHH", port, PORT, 8 + len(lcm), 0) + lcm
        addresses = socket.inet_aton(address) + socket.inet_aton(GROUP)
        raw.sendto(struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(udp), 0, 0, 0, 17, 0) + addresses + udp, (GROUP, 0))
        time.sleep(0.04)
    raw.close()
    check(run.wait(15) == 1, f"exit code: {run.out()}")
    why = json.loads(run.out())["invalid_because"]
    test.say(f"forged source addresses: {why}")
    check(any("numbers of messages began again" in line and "controller.pose.restarts" in line for line in why), f"{why}")
    came = next((re.search(r"(\d+) poses of AGV came, and the relay delivered (\d+)", line) for line in why if "came" in line), None)
    check(came and int(came[1]) == int(came[2]) + 20, f"20 were forged: {why}")


def vars_of(message):
    """Fields of a decoded message."""
    return {name: value for name, value in vars(message).items() if name != "arrival"}


def an_overloaded_run_is_invalid_and_a_short_pause_is_not(test):
    """By stopping the relay, each time for less than a presence may be late."""
    for pauses, pause_s, code in ((1, 0.03, 0), (4, 0.3, 1)):
        run = live(test, "--duration=3", "--json")
        wait_for_loop(test.network, since=time.time())
        relay = run.children()["tether-netem"]
        for _ in range(pauses):
            os.kill(relay, signal.SIGSTOP)
            time.sleep(pause_s)
            os.kill(relay, signal.SIGCONT)
            time.sleep(0.1)
        got = run.wait(15)
        why = json.loads(run.out())["invalid_because"]
        test.say(f"{pauses} pauses of {pause_s} s: {why}")
        check(got == code, f"exit code {got} after {pauses} pauses of {pause_s} s: {why}")
        late = [line for line in why if "the machine was too slow" in line and "tether-netem alone" in line]
        check(len(late) == code, f"{why}")


def a_run_that_refuses_all_commands_is_invalid(test):
    """Refused commands of a controller that names another run."""
    run = live(test, "--duration=3", "--set=controller.external=true")
    wait_for = time.monotonic() + 4
    while time.monotonic() < wait_for and run.process.poll() is None:
        test.network.send("CTRL/CMD_VEL", TWIST.encode(utime=0, seq=int(time.monotonic() * 100), run=77))
        time.sleep(0.05)
    check_verdict(run, 1, "INVALID ")
    check("refused all" in run.out() and "sim.command.other_run" in run.out(), run.out())


def one_command_beside_an_external_controller_makes_the_run_invalid(test):
    """Before its own first one, or among them. An external controller alone does not."""
    for when in ("before", "among", "never"):
        run = live(test, "--duration=3", "--set=controller.external=true")
        wait_until(5, lambda: "tether-netem" in run.children(), "its relay")
        number, controller = run_of(run), Network(PORT + 1, to=PORT)
        if when == "before":
            test.network.send("CTRL/CMD_VEL", TWIST.encode(utime=0, run=number, v_mps=2))
        wait_until(5, lambda: test.network.last("CTRL/POSE"), "a pose")
        deadline, seq = time.monotonic() + 5, 0
        while run.running() and time.monotonic() < deadline:
            utime = test.network.last("CTRL/POSE").utime
            controller.send("CTRL/CMD_VEL", TWIST.encode(utime=utime, seq=seq, run=number, v_mps=0.5))
            seq += 1
            if when == "among" and seq == 20:
                test.network.send("CTRL/CMD_VEL", TWIST.encode(utime=utime, seq=seq, run=number, v_mps=2))
            time.sleep(0.05)
        controller.close()
        check_verdict(run, 0 if when == "never" else 1, "valid " if when == "never" else "INVALID ")
        named = " sent on CTRL/CMD_VEL, which belongs to one external controller" in run.out()
        check(named == (when != "never"), f"{when}: {run.out()}")
        test.network.forget()


def a_run_that_was_not_heard_whole_is_invalid(test):
    """`tether live` cannot judge a message that it has not heard: others may have sent it."""
    run = live(test, "--duration=3")
    wait_for_loop(test.network, since=time.time())
    run.kill(signal.SIGSTOP)
    for _ in range(200):
        test.network.send("MY/NOTES", bytes(60_000))
        time.sleep(0.001)
    run.kill(signal.SIGCONT)
    check_verdict(run, 1, "INVALID ")
    check(re.search(r"this verdict lacks \d+ datagrams: the kernel's buffer was full", run.out()), run.out())


def a_stopped_node_is_told_ended_and_started_again(test):
    run = live(test)
    wait_for_loop(test.network)
    victim = run.children()["tether-controller"]
    os.kill(victim, signal.SIGSTOP)
    began = time.monotonic()
    took = noticed(run, r"tether-controller does not answer: stopped, hung or cut off", 2.5, began)
    ended = noticed(run, r"tether-controller hangs: ending it", 7, began)
    wait_until(3, lambda: run.children().get("tether-controller", victim) != victim, "a new one")
    wait_for_loop(test.network, since=time.time())
    test.say(f"a stopped controller was reported after {took:.2f} s and ended after {ended:.2f} s")
    run.kill(signal.SIGINT)
    check_verdict(run, 1, "INVALID ")
    check("tether-controller does not answer" in run.out(), run.out())


def ends_soon_though_a_node_hangs(test):
    for victims in (["tether-sim"], ["tether-sim", "tether-netem", "tether-controller"]):
        run = live(test)
        wait_for_loop(test.network, since=time.time())
        nodes = run.children()
        for name in victims:
            os.kill(nodes[name], signal.SIGSTOP)
        time.sleep(0.3)
        run.kill(signal.SIGINT)
        began = time.monotonic()
        check(run.wait(6) == 1, f"exit code with {victims} stopped: {run.err()}")
        took = time.monotonic() - began
        check(took < 3.0, f"took {took:.1f} s")
        check(not any(map(alive, nodes.values())), "nodes are left")
        check("tether-sim hangs: ending it" in run.err(), run.err())
        check(run.out().startswith("INVALID "), run.out())
        test.say(f"{len(victims)} stopped: ended after {took:.2f} s")


main(
    a_second_run_is_refused_and_harms_no_node,
    two_that_start_at_once_are_both_invalid,
    a_second_of_each_program_is_named,
    an_unknown_sender_of_commands_is_named,
    one_datagram_makes_the_run_invalid,
    nodes_do_not_act_on_datagrams_of_an_unknown_program,
    a_forged_presence_makes_the_run_invalid,
    a_jump_of_numbers_makes_the_run_invalid,
    a_forged_source_address_makes_the_run_invalid,
    an_overloaded_run_is_invalid_and_a_short_pause_is_not,
    a_run_that_refuses_all_commands_is_invalid,
    one_command_beside_an_external_controller_makes_the_run_invalid,
    a_run_that_was_not_heard_whole_is_invalid,
    a_stopped_node_is_told_ended_and_started_again,
    ends_soon_though_a_node_hangs,
)
