#!/usr/bin/env -S python3 -B
"""Wrong input from a user is refused before anything runs, with a message that names the culprit
and what to do. Usage: bad_input_test.py BIN_DIR"""

import os
import shutil

from live_support import GROUP, NODES, PAPER, PORT, check, main

ALLOWED = "allowed: udpm://GROUP:PORT[?ttl=N&recv_buf_size=N] with GROUP in 224.0.0.0-239.255.255."


def refused(test, code, texts, *command, **options):
    """The command ends at once with `code`, one message on stderr that contains all `texts`."""
    program = test.run(*command, seconds=5, **options)
    message = program.err().strip()
    said = " ".join(str(part) for part in command[2:] if part != PAPER)
    check(program.process.returncode == code, f"{said}: exit code {program.process.returncode}")
    check(program.out() == "", f"{said}: on stdout: {program.out()}")
    check("terminate" not in message and "Segmentation" not in message, message)
    for text in texts:
        check(text in message, f"{said}: no '{text}' in:\n{message}")
    return message


def live_and_nodes(test):
    yield ("tether", "live", PAPER)
    for node in NODES:
        yield (node, PAPER)


def bad_urls(test):
    cases = {
        f"udpm://{GROUP}": "no port",
        f"udpm://{GROUP}:": 'no port',
        f"udpm://{GROUP}:99999": 'port "99999" is not a number from 1 to 65535',
        "udpm://192.168.1.1:7667": "192.168.1.1 is not a multicast group",
        "udpm://robot:7667": '"robot" is not an IPv4 address',
        f"udpm://{GROUP}:7667?tll=1": 'bad option "tll=1"',
        f"udpm://{GROUP}:7667?ttl=999": 'bad option "ttl=999"',
        "udp://239.255.76.67:7667": "not an LCM URL",
        "": "not an LCM URL",
    }
    count = 0
    for command in live_and_nodes(test):
        for url, why in cases.items():
            texts = [f'LCM URL "{url}"', why, ALLOWED]
            text = refused(test, 2, texts, *command, "--lcm-url", url)
            check(text.count("\n") == 0, f"more than one line: {text}")
            count += 1
    refused(
        test, 2, ["no port", ALLOWED], "tether-netem", PAPER, f"--control-lcm-url=udpm://{GROUP}"
    )
    url = f"udpm://{GROUP}"
    refused(test, 2, ["no port"], "tether-sim", PAPER, env=os.environ | {"LCM_DEFAULT_URL": url})
    test.say(f"{count + 2} malformed URLs refused; such as: {text}")


def unreachable_network(test):
    # Loopback without a route, as on a machine that is not on any network.
    alone = ("unshare", "--net", "sh", "-c", 'ip link set lo up; exec "$@"', "sh")
    fix = f"sudo ip link set lo up && sudo ip route add {GROUP}/32 dev lo"
    several_hosts = ("--lcm-url", f"udpm://{GROUP}:{PORT}?ttl=1")
    for command in live_and_nodes(test):
        program = [shutil.which(alone[0]), *alone[1:], test.bin / command[0], *command[1:], *several_hosts]
        text = refused(test, 1, [f"no route for multicast to {GROUP}", fix], *program)
    test.say(f"no route: {text}")
    # The command of the message mends it.
    script = fix.replace("sudo ", "") + '; exec "$@"'
    command = [*alone[1:4], script, "sh", test.bin / "tether", "live", PAPER, "--duration=0.5", *several_hosts]
    mended = test.run(shutil.which("unshare"), *command)
    check(mended.process.returncode == 0, f"the command in the message does not mend it: {fix}")


def bad_scenarios(test):
    misspelt = test.work / "misspelt.toml"
    misspelt.write_text("[run]\nseed = 3\n\n[sensor]\nrate_hertz = 20.0\n")
    missing = test.work / "missing.toml"
    for command in live_and_nodes(test):
        program = command[:-1]
        texts = [f"{misspelt}", "5", '"sensor.rate_hertz"', "sensor.rate_hz"]
        spelling = refused(test, 2, texts, *program, misspelt)
        override = refused(
            test, 2, ["--set", "chanel.prr", "channel."], *command, "--set=chanel.prr=0.5"
        )
        unread = f'cannot read the scenario file "{missing}"'
        absent = refused(test, 2, [unread], *program, missing)
        range_ = refused(
            test, 2, ["channel.uplink.prr", "1.5", "0", "1"], *command, "--set=channel.prr=1.5"
        )
        refused(test, 2, ["scenario is required"], *program)
        refused(test, 2, ["--sed"], *command, "--sed=3")
    for text in (spelling, override, absent, range_):
        test.say(text)


def live_starts_nothing_for_a_bad_scenario(test):
    # Copies of tether beside nodes that only leave a mark.
    test_bin = test.work / "bin"
    test_bin.mkdir()
    shutil.copy(test.bin / "tether", test_bin)
    marks = test.work / "marks"
    marks.mkdir()

    def put_nodes(ending):
        for name in NODES:
            node = test_bin / name
            node.write_text(f"#!/bin/sh\ntouch '{marks}/{name}'\n{ending}\n")
            node.chmod(0o755)

    tether = test_bin / "tether"
    put_nodes("exec sleep 100")
    for option, culprit in (
        ("--set=run.duration_s=-1", "run.duration_s"),
        ("--duration=-1", "--duration"),
        ("--set=sensor.rate_hertz=20", "sensor.rate_hertz"),
        ("--lcm-url=udpm://1.2.3.4", "udpm://1.2.3.4"),
    ):
        refused(test, 2, [culprit], tether, "live", PAPER, option)
    check(not any(marks.iterdir()), f"started {list(marks.iterdir())}")
    # These marks would have shown it:
    silent = refused(
        test, 1, ["no result: no SIM/TRUTH", "udpm://"], tether, "live", PAPER, "--duration=0.5"
    )
    check({mark.name for mark in marks.iterdir()} == set(NODES), "no marks where nodes start")
    test.say(silent)

    # Nodes that refuse, that always fail, that are not there.
    put_nodes("echo 'no good' >&2; exit 2")
    text = refused(test, 1, ["no good", "did not start (exit code 2)"], tether, "live", PAPER)
    test.say(text.splitlines()[-1])
    put_nodes("exit 1")
    text = refused(test, 1, ["did not start (exit code 1)"], tether, "live", PAPER)
    test.say(text.splitlines()[-1])
    # One that ran, and then always fails, is started again, but not forever.
    put_nodes('echo "$(basename "$0"): running, t = 0" >&2; exit 1')
    text = refused(test, 1, ["giving up after 20 restarts"], tether, "live", PAPER)
    test.say(text.splitlines()[-1])
    for name in NODES:
        (test_bin / name).unlink()
    missing = f"cannot start {test_bin}/tether-controller: No such file"
    text = refused(test, 1, [missing], tether, "live", PAPER)
    test.say(text.splitlines()[-1])


def tether_finds_the_programs_beside_it(test):
    for node in NODES:
        direct = test.run(test.bin / node, "--version", seconds=5).out()
        check(direct.startswith(f"{node} "), f"{node} --version says: {direct}")
        through = test.run(test.bin / "tether", node.removeprefix("tether-"), "--version", seconds=5)
        check(through.out() == direct, f"tether {node} says: {through.out()}{through.err()}")
    for words, meant in ((("nonsense",), "tether"), (("can", "stauts"), "status"), (("netem", "shwo"), "show")):
        text = refused(test, 2, [f'"tether {" ".join(words)}"', "did you mean", meant, "--help"], test.bin / "tether", *words)
    test.say(text)
    refused(test, 2, ["run.lcmlog", "is a log"], test.bin / "tether", "echo", "run.lcmlog")
    refused(test, 2, ["tether: error: ", "--sedes", "; see tether run --help"], test.bin / "tether", "run", "--sedes=3")
    # Commands that both programs have: this program's commands, and where the node's help is.
    for command, sub, node in (("can", "estop", "tether-can --help"), ("netem", "fit", "tether-netem --help")):
        said = test.run(test.bin / "tether", command, "--help", seconds=5).out()
        check(sub in said and node in said, f"tether {command} --help: {said}")


def the_journal_is_told_how_bad_it_is(test):
    stream = "JOURNAL_STREAM=$(stat --dereference --format=%d:%i /dev/stderr)"
    command = f"exec {test.bin}/tether-link run none.toml"
    said = test.run("/bin/bash", "-c", f"export {stream}; {command}").err()
    check(said.startswith("<3>tether-link: error: ") and said.count("\n") == 1, said)
    said = test.run("/bin/bash", "-c", f"export {stream}; {command} 2>elsewhere", cwd=test.work).err()
    elsewhere = (test.work / "elsewhere").read_text()
    check(said == "" and elsewhere.startswith("tether-link: error: "), said + elsewhere)


main(
    bad_urls,
    unreachable_network,
    bad_scenarios,
    live_starts_nothing_for_a_bad_scenario,
    tether_finds_the_programs_beside_it,
    the_journal_is_told_how_bad_it_is,
)
