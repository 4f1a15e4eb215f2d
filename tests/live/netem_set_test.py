#!/usr/bin/env -S python3 -B
"""The settings of a running relay's channel: changed and shown by `tether netem`, by anybody's
messages and by a recorded run's, refused with the reason.
Usage: netem_set_test.py BIN_DIR"""

import re
import shutil
import time

from live_support import CHANNEL_SETTING, PAPER, check, main, wait_for_loop, wait_until

FAST = "--set=sensor.rate_hz=20"
ANSWER_S = 1.0  # an answer takes about 10 ms; the machine may be busy


def started(test, *options):
    live = test.start("tether", "live", PAPER, FAST, *options)
    wait_for_loop(test.network)
    return live


def netem(test, *arguments):
    """Output of `tether netem` and its exit code."""
    program = test.run("tether", "netem", *arguments, seconds=8)
    return program.process.returncode, program.out(), program.err()


def poses_of_a_second(test):
    time.sleep(0.2)  # messages under way have arrived
    return test.network.rate("CTRL/POSE", 1.0)


def stops_and_lets_pass_what_it_is_told(test):
    started(test)
    before = poses_of_a_second(test)
    code, said, _ = netem(test, "set", "uplink.prr=0")
    check(code == 0, f"exit code {code}: {said}")
    check(re.fullmatch(r"in force since t = \d+\.\d{3} s:\n  uplink\.prr = 0\.0\n", said), said)
    report = test.network.last("NET/UPLINK")
    check(report.state_prr == 0.0, f"the newest report says PRR {report.state_prr}")
    without = poses_of_a_second(test)
    code, shown, _ = netem(test, "show")
    check(code == 0 and shown.endswith("other than by default:\n  uplink.prr = 0.0\n"), shown)

    code, said, _ = netem(test, "set", "prr=1", "downlink.delay_ms=30", "--lcm-url", test.network.url)
    check(code == 0 and "downlink.delay_ms = 30.0\n" in said, said)
    after = poses_of_a_second(test)
    test.say(f"poses a second: {before:.0f}, with uplink.prr=0 {without:.0f}, then {after:.0f}")
    check(18 <= before <= 22 and without == 0 and 18 <= after <= 22, "poses pass as told")
    sent = {m.seq: m.arrival for m in test.network.messages("CTRL/CMD_VEL")}
    latest = [m for m in test.network.messages("AGV/CMD_VEL", since=time.time() - 0.5)]
    check(min(m.arrival - sent[m.seq] for m in latest) > 0.029, "commands are not delayed")


def refuses_with_the_reason(test):
    started(test)
    for settings, why in (
        (["uplink.prr=0", "prr=2"], "refused, nothing has changed: prr=2: channel.uplink.prr = 2 is"),
        (["uplink.prrr=0"], 'unknown key "uplink.prrr" in [channel] (did you mean "uplink.prr"'),
        (["markov.bad.prr=0"], "channel.uplink.markov.bad.prr has no effect"),
        (["model=trace", "trace.file=nowhere.csv"], 'cannot read the trace "nowhere.csv"'),
    ):
        code, said, errors = netem(test, "set", *settings)
        check(code == 1, f"{settings}: exit code {code}")
        check(why in said and said.count("\n") == 1 and errors == "", f"{settings}: {said}{errors}")
        test.say(said.strip())
    code, shown, _ = netem(test, "show")
    check(shown.endswith("other than by default: nothing\n"), shown)
    check(len(test.network.messages("NET/SETTINGS")) >= 9, "answers are missing on NET/SETTINGS")
    check(poses_of_a_second(test) >= 18, "poses are missing")


def goes_on_relaying_while_it_reads_a_long_file(test):
    long = test.work / "long.csv"
    rows = 3_000_000
    long.write_text("time_s,delay_ms,prr\n" + "".join(f"{n},5,1\n" for n in range(rows)))
    started(test)
    poses_of_a_second(test)
    asked = time.time()
    code, said, _ = netem(test, "set", "model=trace", f"trace.file={long}")
    took = time.time() - asked
    check(code == 0 and "uplink.model = " in said, said)
    arrivals = [m.arrival for m in test.network.messages("CTRL/POSE", since=asked)]
    gap = max(b - a for a, b in zip([asked, *arrivals], arrivals))
    test.say(f"{rows} rows in force after {took:.2f} s, longest gap between poses {gap * 1e3:.0f} ms")
    check(took > 0.4, "the file is too short to try anything")
    check(gap < took / 3, "the relay stood still while it read")


def is_told_off_locally(test):
    code, _, errors = netem(test, "set", "prr")
    check(code == 2 and errors == "tether: error: prr: expected KEY=VALUE\n", f"{code} {errors}")
    started_s = time.monotonic()
    code, _, errors = netem(test, "set", "prr=1")
    took = time.monotonic() - started_s
    check(code == 1 and errors.count("\n") == 1, f"{code} {errors}")
    check("is tether-netem running there?" in errors, errors)
    check(took < 5, f"took {took:.1f} s to find no relay")
    test.say(f"after {took:.1f} s: {errors.strip()}")


def takes_anybodys_message_once(test):
    started(test)
    network = test.network

    def ask(seq, *settings):
        keys, values = zip(*(text.split("=") for text in settings))
        fields = {"utime": 5, "seq": seq, "count": len(keys), "key": keys, "value": values}
        since = time.time()
        network.send("NET/SET", CHANNEL_SETTING.encode(**fields))
        return wait_until(
            ANSWER_S, lambda: network.last("NET/SETTINGS", since=since), f"answer to {seq}"
        )

    first = ask(1, "downlink.prr=0.5", "uplink.delay_ms=10")
    check(first.applied and first.request_seq == 1 and first.request_utime == 5, f"{first}")
    check(first.key == ["uplink.delay_ms", "downlink.prr"], f"{first.key}")
    ask(2, "downlink.prr=1")
    again = ask(1, "downlink.prr=0.5", "uplink.delay_ms=10")
    check(again.applied and again.value == ["10.0", "0.5"], f"{again}")
    check(network.last("NET/DOWNLINK").state_prr == 1.0, "a repeated request acted twice")
    wait_until(
        3, lambda: network.counters("NET/COUNTERS").get("settings.repeated") == 1, "the counter"
    )


def takes_a_recorded_runs_changes(test):
    check(shutil.which("lcm-logplayer"), "lcm-logplayer is missing: apt install liblcm-bin")
    scenario = test.work / "changes.toml"
    change = "[[channel.change]]\nat_s = {}\nset = [{}]\n"
    scenario.write_text(
        "[run]\nduration_s = 2.0\n"
        + change.format(0.5, '"uplink.prr=0.25", "downlink.delay_ms=20"')
        + change.format(1.5, '"uplink.prr=0.75"')
    )
    run = test.run("tether", "run", scenario, "--out", test.work / "run", seconds=20)
    check(run.process.returncode == 0, run.err())
    started(test)
    player = test.start(
        shutil.which("lcm-logplayer"),
        f"--lcm-url={test.network.url}",
        "--regexp=NET/SET",
        test.work / "run" / "run.lcmlog",
    )
    check(player.wait(10) == 0, player.err())
    wait_until(ANSWER_S, lambda: len(test.network.messages("NET/SETTINGS")) == 2, "two answers")
    code, shown, _ = netem(test, "show")
    check(code == 0 and shown.count("\n") == 3, shown)
    check("uplink.prr = 0.75" in shown and "downlink.delay_ms = 20.0" in shown, shown)


def follows_its_scenario(test):
    scenario = test.work / "changes.toml"
    scenario.write_text('[[channel.change]]\nat_s = 2.0\nset = ["downlink.prr=0.5"]\n')
    live = test.start("tether", "live", scenario, FAST, "--duration=3")
    check(live.wait(12) == 0, live.err())
    requests = test.network.messages("NET/SET")
    answers = test.network.messages("NET/SETTINGS")
    check(len(requests) == 1 and len(answers) == 1, f"{len(requests)}, {len(answers)}")
    check(2.0 <= requests[0].utime * 1e-6 < 2.5, f"asked at {requests[0].utime} us")
    check(answers[0].applied and answers[0].key == ["downlink.prr"], f"{answers[0]}")


def a_relay_with_rules_takes_them_for_its_links(test):
    network = test.network
    scenario = test.work / "rules.toml"
    scenario.write_text('[[channel.change]]\nat_s = 0.0\nset = ["links.sat.delay_ms=20"]\n')
    rules = ["--rule=PING -> PONG via uplink", "--rule=PING -> FAR via sat"]
    options = ["--set=channel.links.sat.prr=0.9", "--set=run.report_period_s=0.1"]
    test.start("tether-netem", scenario, *rules, *options)
    wait_until(5, lambda: network.counters("NET/COUNTERS").get("settings.applied") == 1, "a change")
    asked = len(network.messages("NET/SET"))
    check(asked == 1, f"{asked} requests of the scenario's on NET/SET")

    code, said, _ = netem(test, "set", "uplink.prr=0", "links.sat.prr=1")
    check(code == 0 and said.endswith("  uplink.prr = 0.0\n  links.sat.prr = 1.0\n"), said)
    for _ in range(10):
        network.send("PING", b"x")
    wait_until(
        3, lambda: network.counters("NET/COUNTERS").get("sat.delivered") == 10, "what sat carries"
    )
    counters = network.counters("NET/COUNTERS")
    check(counters["uplink.lost"] == counters["uplink.offered"] == 10, f"{counters}")
    code, shown, _ = netem(test, "show")
    check(
        code == 0 and shown.endswith(":\n  uplink.prr = 0.0\n  links.sat.delay_ms = 20.0\n"), shown
    )
    for setting in ("downlink.prr=0.45", "links.foo.prr=0.2"):
        code, said, _ = netem(test, "set", setting)
        why = f"{setting} has no effect: the rules use no link but uplink, sat"
        check(code == 1 and said == f"refused, nothing has changed: {why}\n", said)
        relay = test.run("tether-netem", *rules, *options, f"--set=channel.{setting}", seconds=5)
        check(relay.process.returncode == 2, f"exit code {relay.process.returncode}")
        check(f"--set channel.{why}\n" in relay.err(), relay.err())


main(
    stops_and_lets_pass_what_it_is_told,
    refuses_with_the_reason,
    goes_on_relaying_while_it_reads_a_long_file,
    is_told_off_locally,
    takes_anybodys_message_once,
    takes_a_recorded_runs_changes,
    follows_its_scenario,
    a_relay_with_rules_takes_them_for_its_links,
)
