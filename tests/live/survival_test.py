#!/usr/bin/env -S python3 -B
"""A node that dies takes no other with it. Under `tether live` it is started again and the loop
resumes; without, the vehicle does what the actuator policy says until the node is back.
Usage: survival_test.py BIN_DIR"""

import json
import math
import os
import re
import signal
import time

from live_support import NODES, PAPER, alive, check, main, median, wait_for_loop, wait_until

FAST = ("--set=sensor.rate_hz=20", "--set=controller.pose_timeout_s=0.5")
TIMEOUT_S = 0.3
# scenarios/paper.toml: max_wheel_acceleration_mps2
BRAKING_MPS2 = 3.0
SLACK_S = 0.5


def kill_one_under_supervision(test, live, victim):
    before = live.children()
    check(set(before) == set(NODES), f"runs {sorted(before)}")
    live_line = f"{victim} ended with signal 9; starting it again"
    killed = time.time()
    check(live_line not in live.err(), f"{victim} had died before")
    os.kill(before[victim], signal.SIGKILL)

    def restarted():
        pid = live.children().get(victim)
        return pid is not None and pid != before[victim]

    wait_until(5, restarted, f"{victim} is started again")
    back = time.time()
    wait_until(5, lambda: len(test.network.messages("AGV/CMD_VEL", since=back)) >= 10, "commands")
    silence = back_at_work(test, killed)
    rate = test.network.rate("AGV/CMD_VEL", 1.5)
    truth = test.network.last("SIM/TRUTH", since=killed)
    check(live_line in live.err(), f"tether live does not say that {victim} died: {live.err()}")
    for name, pid in before.items():
        check(name == victim or alive(pid), f"{name} died with {victim}")
    test.say(
        f"{victim} killed: again after {back - killed:.2f} s, loop open for {silence:.2f} s, "
        f"then {rate:.1f} commands/s, epsilon {truth.epsilon_m:.3f} m at {truth.utime * 1e-6:.1f} s"
    )
    check(17 <= rate <= 23, f"{rate} commands/s after the restart of {victim}")
    check(truth.epsilon_m > 0 and math.isfinite(truth.epsilon_m), f"epsilon {truth.epsilon_m}")


def back_at_work(test, killed):
    """How long the vehicle got no command around the kill."""
    arrivals = [m.arrival for m in test.network.messages("AGV/CMD_VEL", since=killed - 1.0)]
    return max(b - a for a, b in zip(arrivals, arrivals[1:]))


def supervisor_restarts_nodes(test):
    live = test.start("tether", "live", PAPER, *FAST, "--duration=60", "--json")
    wait_for_loop(test.network)
    for victim in NODES:
        kill_one_under_supervision(test, live, victim)
    live.kill(signal.SIGINT)
    check(live.wait(3) == 0, "exit code")
    summary = json.loads(live.out())
    check(math.isfinite(summary["epsilon_m"]) and summary["epsilon_m"] > 0, "epsilon")
    check(summary["node_restarts"] == 3, f"{summary['node_restarts']} restarts in the summary")


def start_by_hand(test, *options):
    start = f"--start-utime={int(time.time() * 1e6) + 1_000_000}"
    command = (PAPER, *FAST, start, *options)
    nodes = {name: test.start(name, *command) for name in NODES}
    wait_for_loop(test.network)
    return nodes, command


def speed(test):
    truth = test.network.last("SIM/TRUTH")
    return truth.v_mps if truth else 0.0


def wait_for_driving(test, what):
    wait_until(6, lambda: speed(test) > 0.5, what)


def bring_back(test, nodes, name, command):
    nodes[name] = test.start(name, *command)
    restarted = time.time()
    wait_for_loop(test.network)
    wait_for_driving(test, f"the vehicle drives after the return of {name}")
    return time.time() - restarted


def kill_node(test, nodes, name):
    """Returns the last command that the vehicle got, and its speed then."""
    nodes[name].kill()
    nodes[name].wait(2)
    time.sleep(0.05)  # messages under way arrive
    last = test.network.last("AGV/CMD_VEL")
    for other in NODES:
        check(other == name or nodes[other].running(), f"{other} died with {name}")
    return last


def policy_zero_stops_the_vehicle(test):
    options = ("--set=actuator.policy=zero", f"--set=actuator.timeout_s={TIMEOUT_S}")
    nodes, command = start_by_hand(test, *options)
    for victim in ("tether-controller", "tether-netem"):
        wait_for_driving(test, "the vehicle drives")
        last = kill_node(test, nodes, victim)

        def truths():
            return test.network.messages("SIM/TRUTH", since=last.arrival)

        # In the run's own time, which a busy machine does not stretch.
        at_kill = truths()[0]
        patience = TIMEOUT_S + abs(at_kill.v_mps) / BRAKING_MPS2 + SLACK_S

        def stopped(truth):
            return abs(truth.v_mps) < 0.05 and abs(truth.omega_radps) < 0.05

        wait_until(
            patience + 5, lambda: any(map(stopped, truths())), f"it stands without {victim}"
        )
        after_s = (next(filter(stopped, truths())).utime - at_kill.utime) * 1e-6
        time.sleep(0.5)
        still = test.network.messages("SIM/TRUTH", since=time.time() - 0.3)
        fastest = max(abs(m.v_mps) for m in still)
        check(test.network.last("AGV/CMD_VEL") == last, "commands came from nowhere")
        back_s = bring_back(test, nodes, victim, command)
        test.say(
            f"policy zero, {victim} killed at {at_kill.v_mps:.2f} m/s: stands {after_s:.2f} s "
            f"after the last command (allowed {patience:.2f} s), drives {back_s:.2f} s after the "
            f"restart"
        )
        check(after_s <= patience, f"stopped only after {after_s} s, allowed {patience}")
        check(after_s >= TIMEOUT_S, f"stopped after {after_s} s, before the timeout")
        check(fastest < 0.02, f"it creeps at {fastest} m/s")


def policy_hold_keeps_driving(test):
    nodes, command = start_by_hand(test, "--set=actuator.policy=hold")
    for victim in ("tether-controller", "tether-netem"):
        wait_for_driving(test, "the vehicle drives")
        last = kill_node(test, nodes, victim)
        time.sleep(1.5)
        truths = test.network.messages("SIM/TRUTH", since=time.time() - 0.5)
        v = median(m.v_mps for m in truths)
        check(test.network.last("AGV/CMD_VEL") == last, "commands came from nowhere")
        test.say(
            f"policy hold, {victim} killed: 1.5 s later {v:.3f} m/s, last command {last.v_mps:.3f}"
        )
        check(last.v_mps > 0.3, f"the last command was {last.v_mps} m/s")
        check(abs(v - last.v_mps) < 0.1 * last.v_mps, f"drives at {v}, not at {last.v_mps} m/s")
        bring_back(test, nodes, victim, command)


def nodes_without_start_time_follow_the_simulator(test):
    command = (PAPER, *FAST)
    followers = [test.start(name, *command) for name in ("tether-controller", "tether-netem")]
    for node in followers:
        wait_until(3, lambda: "waiting for SIM/CLOCK on udpm://" in node.err(), f"{node.name} says")
    time.sleep(0.5)
    check(not test.network.channels(), f"messages before the simulator: {test.network.channels()}")
    for node in followers:
        wait_until(4, lambda: "no SIM/CLOCK yet: start tether-sim" in node.err(), f"{node.name} says what to do")
    for round_ in (1, 2):
        started = time.time()
        sim = test.start("tether-sim", *command)
        wait_for_loop(test.network, since=started)
        first = test.network.messages("AGV/CMD_VEL", since=started)[0]
        rate = test.network.rate("AGV/CMD_VEL", 2.0)
        report = test.network.last("CTRL/REPORT")
        truth = test.network.last("SIM/TRUTH")
        apart_ms = (report.utime - truth.utime) * 1e-3
        test.say(
            f"start {round_} of the simulator: first command after "
            f"{first.arrival - started:.2f} s, {rate:.1f} commands/s, "
            f"controller's clock apart by {apart_ms:+.0f} ms"
        )
        check(17 <= rate <= 23, f"{rate} commands/s")
        check(abs(apart_ms) < 200, f"clocks are {apart_ms} ms apart")
        sim.kill()
        sim.wait(2)
    for node in followers:
        check(node.running(), f"{node.name} died with the simulator")
        for count, text in ((2, "waiting for SIM/CLOCK"), (2, ": running, t = ")):
            check(node.err().count(text) == count, f"not {count} times '{text}': {node.err()}")
        check(re.search(r"SIM/CLOCK jumped: starting over", node.err()), node.err())
        node.kill(signal.SIGTERM)
        check(node.wait(3) == 0, f"exit code of {node.name}")


main(
    supervisor_restarts_nodes,
    policy_zero_stops_the_vehicle,
    policy_hold_keeps_driving,
    nodes_without_start_time_follow_the_simulator,
)
