#!/usr/bin/env -S python3 -B
"""`tether run --processes`: nodes as processes over LCM give byte for byte what one process gives,
and a node that fails ends the run at once, with its name.
Usage: lockstep_process_test.py BIN_DIR"""

import os
import signal
import subprocess
import time
from subprocess import PIPE

from live_support import NODES, PAPER, SOURCE, alive, check, main, wait_until

HIL = SOURCE / "scenarios" / "hil_vcan.toml"
FACTORY = SOURCE / "scenarios" / "factory.toml"
RANDOM = ("--set", "sensor.rate_hz=20", "--set", "sensor.position_noise_m=0.02")
RANDOM += ("--set", "channel.prr=0.7", "--set", "channel.delay_ms=35")
FILES = ("run.lcmlog", "trajectory.csv")


def result(test, name, *options):
    run = test.run("tether", "run", "--out", test.work / name, *options, seconds=60)
    check(run.process.returncode == 0, f"{name}: {run.err()}")
    return [(test.work / name / file).read_bytes() for file in FILES]


def gives_what_one_process_gives(test):
    runs = {"whole": (PAPER,), "drives on CAN": (HIL, "--set", "run.duration_s=3")}
    runs["localised by scans"] = (FACTORY, "--set", "run.duration_s=3")
    for seed in ("2", "3"):
        runs[f"seed {seed}"] = (PAPER, *RANDOM, "--seed", seed, "--set", "run.duration_s=8")
    for name, options in runs.items():
        alone = result(test, name, *options)
        before = time.monotonic()
        together = result(test, f"{name} in processes", *options, "--processes")
        took = time.monotonic() - before
        check(len(alone[0]) > 10_000, f"{name}: a log of {len(alone[0])} bytes")
        for file, one, other in zip(FILES, alone, together):
            check(one == other, f"{name}: another {file}")
        test.say(f"{name}: {len(alone[0])} bytes of log, {took:.1f} s")


def mends_what_the_kernel_drops(test):
    """Receive buffers with room for hardly more than one message: some runs lose some."""
    short = (*RANDOM, "--set", "run.duration_s=1")
    url = "udpm://239.255.76.67:7673?ttl=0&recv_buf_size=3000"
    right = result(test, "not lossy", PAPER, *short)
    for attempt in range(30):
        out = test.work / f"lossy {attempt}"
        command = ("tether", "run", PAPER, "--processes", "--out", out, *short, "--lcm-url", url)
        run = test.run(*command, seconds=60)
        check(run.process.returncode == 0, run.err())
        for file, one in zip(FILES, right):
            check((out / file).read_bytes() == one, f"losses: another {file}")
        if "grants were repeated" in run.err():
            test.say(run.err().splitlines()[-1])
            return
    check(False, "nothing was lost")


def started(test, *options, scenario=PAPER, names=NODES, log_size=50_000):
    """A long run that is on its way."""
    out = test.work / f"run {len(test.programs)}"
    options = ("--set", "run.duration_s=100000", "--out", out, *RANDOM, *options)
    run = test.start("tether", "run", scenario, "--processes", *options)
    log = out / "run.lcmlog"
    wait_until(10, lambda: log.exists() and log.stat().st_size > log_size, "the run is on its way")
    nodes = run.children()
    check(set(nodes) == set(names), f"runs {sorted(nodes)}")
    return run, nodes, out


def check_ended(test, run, nodes, out, seconds, *words):
    before = time.monotonic()
    code = run.wait(seconds)
    took = time.monotonic() - before
    check(code == 1, f"exit code {code}")
    for word in words:
        check(word in run.err(), f'no "{word}" in: {run.err()}')
    wait_until(2, lambda: not any(map(alive, nodes.values())), "nodes are gone")
    check(words[0] in (out / "incomplete.txt").read_text(), "not marked incomplete")
    check(not (out / "summary.json").exists(), "a summary of what is incomplete")
    check((out / "trajectory.csv").stat().st_size > 1000, "what there was is not kept")
    check((out / "run.lcmlog").stat().st_size > 50_000, "what there was is not kept")
    test.say(f"after {took:.1f} s: {run.err().splitlines()[-1]}")


def names_the_node_that_was_killed(test):
    for name in NODES:
        run, nodes, out = started(test)
        os.kill(nodes[name], signal.SIGKILL)
        short = name.removeprefix("tether-")
        check_ended(test, run, nodes, out, 3, f"{short} was killed by signal 9", "owed")
    names = (*NODES, "tether-can")
    run, nodes, out = started(test, scenario=HIL, names=names, log_size=600_000)  # t > 0
    os.kill(nodes["tether-can"], signal.SIGKILL)
    check_ended(test, run, nodes, out, 3, "can was killed by signal 9", "owed")


def names_the_node_that_is_silent(test):
    run, nodes, out = started(test, "--patience", "1")
    os.kill(nodes["tether-netem"], signal.SIGSTOP)
    words = ("netem did not answer within 1.0 s", "it owes the answer to grant")
    check_ended(test, run, nodes, out, 4, *words)


def names_the_node_that_is_stopped_for_any_waiting_node(test):
    # Its last messages may not have left when it stops: others then wait for those, not for it.
    for _ in range(3):
        for program, node in (("tether-sim", "sim"), ("tether-controller", "controller")):
            run, nodes, out = started(test, "--patience", "1")
            os.kill(nodes[program], signal.SIGSTOP)
            check_ended(test, run, nodes, out, 5, f"{node} did not answer", "is stopped")
            check("rmem" not in run.err(), f"blames a buffer: {run.err()}")


def stopped_before_it_joins(test, *options):
    """A run whose relay was stopped before it could join, and the relay's process."""
    for _ in range(20):
        run = test.start("tether", "run", PAPER, "--processes", *options, "--set", "run.duration_s=1")
        wait_until(5, lambda: "tether-netem" in run.children(), "its relay")
        relay = run.children()["tether-netem"]
        os.kill(relay, signal.SIGSTOP)
        time.sleep(4)
        if "still waiting for netem on" in run.err():
            return run, relay
        run.kill()
    check(False, "the relay always joined first")


def waits_for_a_late_node_as_long_as_it_is_asked_to(test):
    """A busy machine may need half a minute to start a program."""
    late, relay = stopped_before_it_joins(test, "--patience=60", "--out", test.work / "late")
    impatient, _ = stopped_before_it_joins(test, "--out", test.work / "impatient")
    check(impatient.wait(20) == 1, "exit code")
    check("netem did not join within 20 s: its process" in impatient.err(), impatient.err())
    os.kill(relay, signal.SIGCONT)
    check(late.wait(20) == 0, late.err())


def names_the_node_that_joins_twice(test):
    url = "udpm://239.255.76.67:7674?ttl=0"
    run, nodes, out = started(test, "--lcm-url", url)
    test.start("tether-netem", PAPER, "--lockstep", "0", "--lcm-url", url)
    check_ended(test, run, nodes, out, 3, "netem joined twice, the second time late")


def ends_on_a_signal_and_keeps_what_there_is(test):
    for number in (signal.SIGINT, signal.SIGHUP):
        run, nodes, out = started(test)
        run.kill(number)
        check_ended(test, run, nodes, out, 3, f"ended by signal {int(number)}")


def leaves_nothing_behind_when_killed(test):
    run, nodes, _ = started(test)
    run.kill(signal.SIGKILL)
    run.wait(3)
    wait_until(2, lambda: not any(map(alive, nodes.values())), "nodes are gone")


def refuses_what_it_cannot_run(test):
    for options, word in (
        (("--lcm-url", "tcpq://127.0.0.1:7700"), "udpm"),
        (("--lcm-url", "udpm://239.255.76.67"), "port"),
    ):
        run = test.run("tether", "run", PAPER, "--processes", *options)
        check(run.process.returncode == 2 and word in run.err(), f"{options}: {run.err()}")
    for options in (("--step",), ("--patience", "3"), ("--lcm-url", "udpm://239.255.76.67:7675")):
        run = test.run("tether", "run", PAPER, *options)
        check(run.process.returncode == 2 and "--processes" in run.err(), f"{options}: {run.err()}")
    run = test.run("tether", "run", PAPER, "--processes", "--patience", "nan")
    check(run.process.returncode == 2 and "not a number" in run.err(), run.err())
    for program, option in (("sim", "--start-utime=1"), ("netem", "--control-lcm-url=x")):
        run = test.run(f"tether-{program}", PAPER, "--lockstep", "0", option)
        check(run.process.returncode == 2 and "--lockstep" in run.err(), f"{option}: {run.err()}")


def obeys_the_terminal(test):
    """Lines on the standard input, as from a terminal."""
    out = test.work / "stepped"
    command = (test.bin / "tether", "run", PAPER, "--processes", "--step", "--out", out, *RANDOM)
    command += ("--set", "run.duration_s=8", "--seed", "2")
    run = subprocess.Popen(command, stdin=PIPE, stdout=PIPE, stderr=PIPE, text=True, bufsize=1)

    def ask(line):
        run.stdin.write(line + "\n")

    def stands():
        """The next report of where the run stands."""
        line = run.stderr.readline()
        check(line.startswith("t = "), f"no report: {line}")
        return float(line.split()[2]), line

    check("on udpm://" in run.stderr.readline(), "does not say where to listen")
    check("one grant" in run.stderr.readline(), "no help")
    check(stands()[0] == 0.0, "does not begin at 0")
    ask("")
    check("after grant 16 to sim" in (line := stands()[1]), line)
    ask("s 10")
    seen = [stands()[1] for _ in range(10)]
    check(all(f"after grant {17 + i} to " in line for i, line in enumerate(seen)), f"{seen}")
    decision = "to controller, with CTRL/POSE 1; it published CTRL/CMD_VEL 1"
    check(any(decision in line for line in seen), f"{seen}")
    ask("u 2.5")
    check(2.5 < stands()[0] < 2.6, "does not stop at 2.5 s")
    time.sleep(0.5)  # messages under way are written
    size = (out / "run.lcmlog").stat().st_size
    time.sleep(0.5)
    check((out / "run.lcmlog").stat().st_size == size, "does not stand still")
    ask("s 1000000")
    stands()
    ask("")
    ask("p")  # forgets both
    time.sleep(0.5)
    ask("c")
    _, errors = run.communicate(timeout=20)
    check(run.returncode == 0, errors)
    check(errors.count("t = ") < 20_000, "was not stopped")
    alone = result(test, "not stepped", PAPER, *RANDOM, "--set", "run.duration_s=8", "--seed", "2")
    check((out / "run.lcmlog").read_bytes() == alone[0], "stepping changed the run")


def obeys_a_file(test):
    commands = test.work / "commands"
    commands.write_text("s 2\nu 1.5\n")
    command = (test.bin / "tether", "run", PAPER, "--processes", "--step", *RANDOM)
    for name, stops in ((commands, 4), ("/dev/null", 1)):
        with open(name, encoding="utf-8") as lines:
            run = subprocess.run(
                (*command, "--set", "run.duration_s=3"), stdin=lines, capture_output=True, text=True
            )
        check(run.returncode == 0, run.stderr)
        check(run.stderr.count("t = ") == stops, run.stderr)


main(
    gives_what_one_process_gives,
    mends_what_the_kernel_drops,
    names_the_node_that_was_killed,
    names_the_node_that_is_silent,
    names_the_node_that_is_stopped_for_any_waiting_node,
    waits_for_a_late_node_as_long_as_it_is_asked_to,
    names_the_node_that_joins_twice,
    ends_on_a_signal_and_keeps_what_there_is,
    leaves_nothing_behind_when_killed,
    refuses_what_it_cannot_run,
    obeys_the_terminal,
    obeys_a_file,
)
