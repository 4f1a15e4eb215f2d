#!/usr/bin/env -S python3 -B
"""tether netem check and tether netem export-tc, as their users call them.
Usage: netem_commands_test.py BIN_DIR"""

import json
import shutil

from live_support import PAPER, SOURCE, check, main

MARKOV = SOURCE / "scenarios" / "paper_markov.toml"
QUANTITIES = ["PRR", "delay p50", "delay p90", "delay p99"]


def netem(test, code, *arguments):
    program = test.run(test.bin / "tether", "netem", *arguments, seconds=60)
    said = " ".join(str(argument) for argument in arguments)
    came = program.process.returncode
    check(came == code, f"{said}: exit code {came}, {program.err()}")
    return program.out(), program.err()


def set_keys(*keys):
    return [part for key in keys for part in ("--set", key)]


def check_tells_right_links_from_short_ones(test):
    for scenario in (PAPER, MARKOV):
        out, err = netem(test, 0, "check", scenario)
        check(err == "", f"on stderr, no terminal: {err}")
        check("uplink: 1000000 packets of 72 bytes, one every 1000 ms: ok" in out, out)
        check("downlink: 1000000 packets of 56 bytes, one every 1000 ms: ok" in out, out)
        check("95 % interval" in out and "at most 0.001" in out, out)
    out, err = netem(test, 1, "check", MARKOV, "--packets", "100")
    check("uplink had too few packets to say: give more than --packets 100" in err, err)
    check("too short" in out, out)


def check_speaks_json_and_repeats_itself(test):
    arguments = ["check", PAPER, "--json", "--packets", "50000", "--seed", "7"]
    arguments += set_keys("channel.prr=0.5", "channel.downlink.delay_ms=20")
    out, _ = netem(test, 0, *arguments)
    check(out == netem(test, 0, *arguments)[0], "another output with the same seed")
    summary = json.loads(out)
    check(summary["seed"] == 7 and summary["false_alarm"] == 0.001, out)
    for name, delay_ms in (("uplink", 0.0), ("downlink", 20.0)):
        link = summary[name]
        check(link["packets"] == 50000 and link["channel_check"] == "ok", link)
        rows = {row["quantity"]: row for row in link["check"]}
        check(all(quantity in rows for quantity in QUANTITIES), rows)
        check(rows["PRR"]["low"] < rows["PRR"]["achieved"] < rows["PRR"]["high"], rows["PRR"])
        check(rows["delay p99"]["achieved"] == delay_ms, rows["delay p99"])


def bad_input_is_refused(test):
    for arguments, what in (
        (["check"], "scenario is required"),
        (["check", "nothing.toml"], "nothing.toml"),
        (["check", PAPER, "--packets", "0"], "--packets"),
        (["check", PAPER, "--packets", "1000000000", "--set", "sensor.rate_hz=0.1"], "at most 4"),
        (["check", PAPER, *set_keys("channel.prr=2")], "channel.prr"),
        (["export-tc"], "scenario is required"),
        (["export-tc", PAPER, "--interface", "eth0; reboot"], "--interface"),
        (["export-tc", PAPER, "--interface", "aninterfacewithalongname"], "--interface"),
    ):
        _, err = netem(test, 2, *arguments)
        check(what in err, f"no '{what}' in: {err}")


JITTER = "channel.jitter.mean_ms=30 channel.jitter.sd_ms=10 channel.jitter.law="
EXPORTS = [
    "channel.prr=0.45 channel.delay_ms=100",
    JITTER + "normal",
    JITTER + "uniform channel.in_order=true channel.corrupt.probability=1e-5",
    JITTER + "pareto channel.reorder.probability=0.25 channel.reorder.gap=5",
    JITTER + "paretonormal channel.rate.bits_per_s=1e6 channel.duplicate.probability=0.02",
    "channel.model=gilbert_elliott channel.gilbert_elliott.prr=0.8 "
    "channel.gilbert_elliott.mean_burst=4",
    "channel.model=four_state channel.four_state.p13=0.02 channel.four_state.p31=0.3",
]


def export_is_a_script_that_tc_understands(test):
    tc = shutil.which("tc") or shutil.which("tc", path="/usr/sbin:/sbin")
    for keys in EXPORTS:
        out, err = netem(test, 0, "export-tc", PAPER, "--interface", "lo", *set_keys(*keys.split()))
        check(err == "", err)
        commands = [line for line in out.splitlines() if not line.startswith("#")]
        check(len(commands) == 2, out)
        for command in commands:
            words = command.split()
            check(words[:7] == "tc qdisc add dev lo root netem".split(), command)
            if tc is None:
                continue
            # In the test's own network. A kernel without netem, or the loopback's second qdisc,
            # is refused by the kernel: then tc has read all options.
            program = test.run(tc, *words[1:], seconds=5)
            said = program.err()
            refused = said.startswith(("Error:", "RTNETLINK")) and "argument" not in said
            read = program.process.returncode == 0 or refused
            check(read, f"{command}: {said}")
    test.say(commands[0])
    if tc is None:
        test.say("tc is missing (apt install iproute2): its reading is not tested")


main(
    check_tells_right_links_from_short_ones,
    check_speaks_json_and_repeats_itself,
    bad_input_is_refused,
    export_is_a_script_that_tc_understands,
)
