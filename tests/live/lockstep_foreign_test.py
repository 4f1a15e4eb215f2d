#!/usr/bin/env -S python3 -B
"""Controllers that are not the run's own: the examples in Python and C++, in simulated time and in
real time; and one on another host. Usage: lockstep_foreign_test.py BIN_DIR"""

import os
import subprocess
import time

from live_support import GROUP, PAPER, SOURCE, LcmType, TYPES, check, main, wait_for_loop, wait_until

EXAMPLE = (SOURCE / "examples" / "controller.py", "--scenario", PAPER)
SAME_AS_CPP = SOURCE / "tests" / "python" / "law_of_the_example.py"
os.environ["PYTHONPATH"] = str(SOURCE / "python")
FAST = ("--set", "sensor.rate_hz=10", "--set", "channel.prr=0.9", "--set", "channel.delay_ms=20")
EXTERNAL = ("--set", "controller.external=true")


def cpp(test):
    return test.bin.parent / "examples" / "example_controller"


def run_with(test, name, controller, *options, url=f"udpm://{GROUP}:7671?ttl=0"):
    """run.lcmlog of a run in lockstep with this controller."""
    out = test.work / name
    options = ("--out", out, "--lcm-url", url, *FAST, *options)
    run = test.start("tether", "run", PAPER, "--processes", *EXTERNAL, *options)
    wait_until(5, lambda: 'waiting for the node "controller"' in run.err(), "it waits")
    foreign = test.start(*controller, "--lcm-url", url)
    check(run.wait(30) == 0, f"{name}: {run.err()}")
    check(foreign.wait(5) == 0, f"{name}: the controller does not leave")
    return (out / "run.lcmlog").read_bytes()


def examples_are_the_same_however_slow(test):
    short = ("--set", "run.duration_s=3")
    fast = run_with(test, "python", (SAME_AS_CPP,), *short)
    check(fast.count(b"CTRL/CMD_VEL") > 20, "hardly any commands")
    before = time.monotonic()
    slow = run_with(test, "slow", ("/usr/bin/env", "THINK_S=0.05", SAME_AS_CPP), *short)
    took = time.monotonic() - before
    check(took > 20 * 0.05, f"{took:.2f} s: it was not slow")
    check(slow == fast, "the slow controller's run is another")
    check(run_with(test, "c++", (cpp(test), "--lockstep"), *short) == fast, "C++ gives another run")
    test.say(f"{len(fast)} bytes of log each; the slow one took {took:.1f} s")


def examples_follow_the_path(test):
    for name, controller in (("python", EXAMPLE), ("c++", (cpp(test), "--lockstep"))):
        follows_the_path(test, name, run_with(test, f"path in {name}", controller))


def follows_the_path(test, name, whole):
    truth = TYPES["SIM/TRUTH"]
    at = whole.rindex(b"SIM/TRUTH") + len(b"SIM/TRUTH")
    size = int.from_bytes(whole[at - len(b"SIM/TRUTH") - 4 : at - len(b"SIM/TRUTH")], "big")
    last = truth.decode(whole[at : at + size])
    check(last.utime == 62_000_000, f"the last truth is of {last.utime} us")
    check(last.epsilon_m < 2.5, f"error {last.epsilon_m:.2f} m")
    test.say(f"{name}: epsilon {last.epsilon_m:.2f} m")


def examples_work_in_real_time(test):
    for name, controller in (("python", EXAMPLE), ("c++", (cpp(test),))):
        live = test.start("tether", "live", PAPER, *EXTERNAL, *FAST)
        foreign = test.start(*controller)
        wait_for_loop(test.network, since=time.time())
        check(not test.network.messages("CTRL/REPORT"), "another controller runs")
        for program in (live, foreign):
            program.kill(15)
            program.wait(3)
        test.say(f"{name}: commands reach the vehicle")


LIAR = """
import sys
import tether
channel, kind = sys.argv.pop(1), sys.argv.pop(1)

def lies(self, grant, published, honest=tether.Lockstep._run):
    on_pose = self._controller.on_pose
    self._controller.on_pose = lambda *seen: on_pose(*seen) + [(channel, tether.message_type(kind).encode())]
    try:
        honest(self, grant, published)
    finally:
        self._controller.on_pose = on_pose

tether.Lockstep._run = lies
tether.main(lambda t, pose, path: (0.5, 0.1))
"""


def a_controller_owns_its_channels_alone(test):
    """A controller that says where the vehicle is, or goes round the network, ends the run."""
    (test.work / "liar.py").write_text(LIAR)
    for channel, kind, owner in (
        ("SIM/TRUTH", "ground_truth_t", "sim"), ("AGV/CMD_VEL", "twist_t", "netem"), ("NET/SET", "channel_setting_t", "netem"),
        ("AGV/POSE", "pose_t", "sim"), ("NET/UPLINK", "link_report_t", "netem"), ("SIM/CLOCK", "clock_t", "sim"),
    ):
        command = f"python3 -B {test.work}/liar.py {channel} {kind} --url {{url}} --scenario {{scenario}}"
        for way in ((), ("--processes",)):
            run = test.start("tether", "run", PAPER, *way, *FAST, "--set", "run.duration_s=2",
                             "--set", f'controller.command="{command}"', "--out", test.work / "lies")
            check(run.wait(60) == 1, f"{channel}: exit code {run.wait(1)}: {run.err()}")
            why = f"controller published on {channel}, which belongs to {owner} (grant "
            check(why in run.err(), f"{channel}: {run.err()}")
    test.say("a liar is named on 6 channels, with and without processes")


def works_between_two_hosts(test):
    """A second network namespace at the other end of a cable: two hosts of one LCM network."""
    other = test.start("/usr/bin/env", "unshare", "--net", "sleep", "100")
    time.sleep(0.2)
    there = ("nsenter", "-t", str(other.pid), "-n")
    for command in (
        ("ip", "link", "add", "here", "type", "veth", "peer", "name", "there"),
        ("ip", "link", "set", "there", "netns", str(other.pid)),
        ("ip", "address", "add", "10.9.8.1/24", "dev", "here"),
        ("ip", "link", "set", "here", "up"),
        ("ip", "route", "add", f"{GROUP}/32", "dev", "here"),
        (*there, "ip", "link", "set", "lo", "up"),
        (*there, "ip", "address", "add", "10.9.8.2/24", "dev", "there"),
        (*there, "ip", "link", "set", "there", "up"),
        (*there, "ip", "route", "add", f"{GROUP}/32", "dev", "there"),
    ):
        subprocess.run(command, check=True)
    try:
        url = f"udpm://{GROUP}:7672?ttl=1"
        short = ("--set", "run.duration_s=10")
        controller = (test.bin / "tether-controller", PAPER, "--lockstep", "0")
        controller = ("/usr/bin/env", *there, *controller, *FAST, *short)
        remote = run_with(test, "remote", controller, *short, url=url)
        alone = test.run("tether", "run", PAPER, "--out", test.work / "alone", *FAST, *short)
        check(alone.process.returncode == 0, alone.err())
        log = (test.work / "alone" / "run.lcmlog").read_bytes()
        check(len(log) > 50_000 and log == remote, "another run between two hosts")
        test.say(f"{len(log)} bytes of log, as in one process")
    finally:
        subprocess.run(("ip", "link", "delete", "here"), check=True)


def waiting_says_for_whom_and_ends_with_the_coordinator(test):
    url = f"udpm://{GROUP}:7673?ttl=0"
    run = test.start("tether", "run", PAPER, "--processes", *EXTERNAL, "--lcm-url", url)
    wait_until(8, lambda: "still waiting for controller on" in run.err(), "it says for whom it waits")
    check("come back" not in run.err(), f"its messages come back: {run.err()}")
    run.kill()

    # Who has heard of a coordinator, and never got further, does not wait for ever.
    began = time.monotonic()
    strays = [test.start(*controller) for controller in (EXAMPLE, (cpp(test), "--lockstep"))]
    time.sleep(1.0)
    to_no_node = {"seq": 0, "session": 7, "instance": 0, "node": "", "rank": 0, "run_key": "", "node_key": "", "count": 0, "subscription": []}
    test.network.send("TIME/WELCOME", LcmType("time_welcome").encode(utime=0, **to_no_node))
    for stray in strays:
        stray.wait(40)
        check("silent for 30 s" in stray.err(), f"the controller: {stray.err()}")
        check(time.monotonic() - began > 29, "it has not waited")


main(
    waiting_says_for_whom_and_ends_with_the_coordinator,
    examples_are_the_same_however_slow,
    examples_follow_the_path,
    a_controller_owns_its_channels_alone,
    examples_work_in_real_time,
    works_between_two_hosts,
)
