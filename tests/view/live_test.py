#!/usr/bin/env -S python3 -B
"""tether view on real sockets: what is heard arrives, what is set is in force and in the recording, logs
are played, what the user gets wrong is said. Usage: live_test.py BIN_DIR"""

import csv
import io
import json
import re
import signal
import time

from view_client import Client, address_of, http
from live_support import PAPER, POSE, check, main, wait_for_loop, wait_until

IN_FORCE_S = 0.1  # from a client's request to the relay's report with the new setting


def a_live_run_is_seen_and_its_network_set(test):
    out = test.work / "out"
    live = test.start(
        "tether", "live", PAPER, "--set=sensor.rate_hz=20", "--view", "--port=0", "--out", out
    )
    wait_for_loop(test.network)
    client = Client(address_of(live))
    client.wait(5, lambda: {"SIM/TRUTH", "CTRL/POSE", "VIEW/FRAMES"} <= client.channels.keys(), "channels")
    client.subscribe("SIM/TRUTH", "CTRL/POSE", "VIEW/SCENE", "VIEW/FRAMES")
    client.wait(5, lambda: client.counts.get("CTRL/POSE", 0) > 10, "poses")
    pose = json.loads(client.last["CTRL/POSE"])
    heard = {m.seq: m for m in test.network.messages("CTRL/POSE")}[pose["seq"]]
    check(pose["x_m"] == heard.x_m and pose["run"] == heard.run, f"{pose} is not {heard}")
    scene = json.loads(client.last["VIEW/SCENE"])
    check(len(scene["entities"]) >= 2, f"the scene has {len(scene['entities'])} entities")

    client.send(op="getParameters", parameterNames=[], id="all")
    client.wait(2, lambda: client.parameters.get("network.uplink.prr") == 1.0, "the PRR in force")
    delays = []
    for prr in (0.0, 0.5, 0.9, 0.1, 1.0):
        asked = time.time()
        client.set("network.uplink.prr", prr)
        client.wait(2, lambda: client.parameters["network.uplink.prr"] == prr, "the answer")
        report = wait_until(
            2,
            lambda: next((m for m in test.network.messages("NET/UPLINK", since=asked) if m.state_prr == prr), None),
            f"a report with PRR {prr}",
        )
        delays.append(report.arrival - asked)
    test.say(f"in force after {1e3 * max(delays):.0f} ms at most")
    check(max(delays) < IN_FORCE_S, f"settings were in force after {delays} s")

    client.set("network.uplink.prr", 2.0)
    client.wait(2, lambda: client.status, "the refusal")
    check("must be a number in [0, 1]" in client.status[0]["message"], client.status)
    check(client.parameters["network.uplink.prr"] == 1.0, "the client receives the setting in force")

    live.kill(signal.SIGINT)
    check(live.wait(10) == 0, f"exit code {live.process.returncode}: {live.err()}")
    client.read(0.2)
    table = test.run("tether", "log", "csv", out / "run.lcmlog", "NET/SET").out()
    values = [row["value"] for row in csv.DictReader(io.StringIO(table)) if row["key"] == "uplink.prr"]
    check(values == ["0", "0.5", "0.9", "0.1", "1", "2"], f"in the recording are {values}")


def an_unknown_network_is_seen(test):
    view = test.start("tether", "view", "--port=0", "--lcm-url", test.network.url)
    client = Client(address_of(view))
    for seq in range(20):
        test.network.send("ELSEWHERE", POSE.encode(seq=seq, x_m=1.5))
        test.network.send("NOT/OURS", b"whatever")
        client.read(0.01)
    client.wait(2, lambda: "ELSEWHERE" in client.channels, "the channel")
    client.subscribe("ELSEWHERE")
    client.wait(2, lambda: client.counts.get("ELSEWHERE"), "the newest message, at once")
    check(json.loads(client.last["ELSEWHERE"])["x_m"] == 1.5, "it is another")
    check("NOT/OURS" not in client.channels, "a channel that cannot be decoded is shown")
    client.set("network.uplink.prr", 0.5)
    client.wait(5, lambda: client.status, "that there is no relay")
    check("is there a relay" in client.status[0]["message"], client.status)


def a_log_is_played(test):
    out = test.work / "out"
    test.run("tether", "run", PAPER, "--set=run.duration_s=20", "--out", out, seconds=60)
    log = out / "run.lcmlog"
    view = test.start("tether", "view", log, "--port=0")
    address = address_of(view)
    client = Client(address)
    client.send(op="subscribeParameterUpdates", parameterNames=[])
    client.send(op="getParameters", parameterNames=[])
    client.wait(5, lambda: client.parameters.get("playback.playing") is True, "it plays")
    client.set("playback.playing", False)
    client.wait(2, lambda: client.parameters["playback.playing"] is False, "it stands")
    client.wait(2, lambda: "SIM/TRUTH" in client.channels, "channels")
    client.subscribe("SIM/TRUTH")
    client.set("playback.position_s", 12.5)
    client.wait(2, lambda: client.parameters["playback.position_s"] == 12.5, "it has jumped")
    client.wait(2, lambda: json.loads(client.last.get("SIM/TRUTH", b"{\"utime\":0}"))["utime"] > 12.4e6, "its state")
    check(json.loads(client.last["SIM/TRUTH"])["utime"] <= 12.5e6, "the state is of later")
    before = client.counts["SIM/TRUTH"]
    client.set("playback.speed", 100.0)
    client.set("playback.playing", True)
    client.wait(3, lambda: client.parameters["playback.position_s"] == 20.0, "it plays to its end")
    check(client.counts["SIM/TRUTH"] > before + 50, "messages are missing")
    client.set("playback.speed", 1000.0)
    client.wait(2, lambda: client.status, "the refusal")
    check("playback.speed has to be a number in [0.1, 100]" in client.status[0]["message"], client.status)

    run = json.loads(http(address, "/api/run.json")[2])
    check(run["kind"] == "log" and run["half_extent_m"] == 22.0 and len(run["path"]) > 100, "run.json")
    check(run["scenario"]["channel"]["uplink"]["prr"] == 1.0, "the scenario beside the log")


def a_log_that_breaks_off_is_played_as_far_as_it_goes(test):
    out = test.work / "out"
    test.run("tether", "run", PAPER, "--set=run.duration_s=5", "--out", out, seconds=60)
    cut = test.work / "cut.lcmlog"
    cut.write_bytes((out / "run.lcmlog").read_bytes()[:50_000])
    view = test.start("tether", "view", cut, "--port=0")
    address = address_of(view)
    check("ends in the middle of the record" in view.err(), view.err())
    notes = json.loads(http(address, "/api/run.json")[2])["notes"]
    check(len(notes) == 1 and "ends in the middle" in notes[0], notes)
    client = Client(address)
    client.wait(5, lambda: "SIM/TRUTH" in client.channels, "its channels")


def a_computed_run_is_paced_and_the_same(test):
    settings = [PAPER, "--set=run.duration_s=4", "--set=channel.prr=0.45"]
    test.run("tether", "run", *settings, "--out", test.work / "a", seconds=60)
    run = test.start("tether", "run", *settings, "--out", test.work / "b", "--view", "--port=0", "--speed=2")
    client = Client(address_of(run))
    client.send(op="subscribeParameterUpdates", parameterNames=[])
    started = time.monotonic()
    run.wait(60)
    test.say(f"4 s at twice the pace took {time.monotonic() - started:.1f} s")
    check(time.monotonic() - started > 1.5, "it was not paced")
    check(run.process.returncode == 0, run.err())
    logs = [(test.work / name / "run.lcmlog").read_bytes() for name in "ab"]
    check(logs[0] == logs[1], "the log differs from that of a run without a viewer")


def a_fleet_is_seen_and_the_links_of_all_are_set(test):
    fleet = [
        PAPER, "--set=fleet.count=3", "--set=vehicle.plant=kinematic", "--set=sensor.rate_hz=10",
        "--set=fleet.vehicle.2.controller.law=tracking", "--set=fleet.vehicle.3.channel.model=markov",
    ]
    out = test.work / "out"
    run = test.start("tether", "run", *fleet, "--view", "--port=0", "--speed=5", "--out", out)
    address = address_of(run)
    about = json.loads(http(address, "/api/run.json")[2])
    check(about["vehicle"] == "AGV1" and about["publishable"] == [], about["publishable"])
    check([one["name"] for one in about["vehicles"]] == ["AGV1", "AGV2", "AGV3"], "its vehicles")
    check(about["vehicles"][1]["scenario"] == {"controller": {"law": "tracking", "tracking": {
        "k_x": 2.5, "k_y": 0.8, "k_theta": 2.0, "max_lateral_mps2": 3.0}}}, about["vehicles"][1]["scenario"])
    check([one["path"] for one in about["vehicles"]] == [0, 0, 0] and len(about["paths"]) == 1, "one path for all")
    client = Client(address)
    truths = {f"SIM{number}/TRUTH" for number in (1, 2, 3)}
    client.wait(10, lambda: truths <= client.channels.keys(), "all vehicles")
    client.subscribe(*truths)
    client.send(op="getParameters", parameterNames=[], id="all")
    client.wait(5, lambda: client.parameters.get("network.uplink.prr") == 1.0, "the PRR in force")
    client.set("network.uplink.delay_ms", 70.0)
    client.wait(5, lambda: client.parameters["network.uplink.delay_ms"] == 70.0 and client.status, "the answers")
    check(client.status[0]["message"].startswith("refused by the links of AGV3, in force for the others: "),
          client.status)
    client.wait(5, lambda: truths <= client.counts.keys(), "their truths")
    run.kill(signal.SIGINT)
    run.wait(20)
    for number, delay_ms in ((1, "70"), (2, "70")):
        table = test.run("tether", "log", "csv", out / "run.lcmlog", f"NET{number}/UPLINK", seconds=30).out()
        found = [row["state_delay_ms"] for row in csv.DictReader(io.StringIO(table))]
        check(found[0] == "0" and found[-1] == delay_ms, f"AGV{number}: {found[0]} and then {found[-1]} ms")


def a_computed_run_ends_orderly_when_it_is_told_to(test):
    for more in (("--view", "--port=0"), ()):
        out = test.work / f"out{len(more)}"
        run = test.start("tether", "run", PAPER, "--set=run.duration_s=4000", "--out", out, *more)
        if more:
            address_of(run)
        wait_until(10, lambda: (out / "run.lcmlog").exists() and (out / "run.lcmlog").stat().st_size > 100_000, "a log")
        run.kill(signal.SIGINT)
        check(run.wait(10) == 1, f"exit code {run.process.returncode}")
        check(re.search(r"ended by signal 2 at t = \d+\.\d+ s$", run.err().strip()), run.err())
        check(run.out() == "", f"a summary of a part: {run.out()}")
        check("ended by signal 2 at t = " in (out / "incomplete.txt").read_text(), "it does not say why")
        check(not (out / "summary.json").exists(), "it is reported as complete")
        said = test.run("tether", "log", "info", out / "run.lcmlog", seconds=30).out()
        check("in the middle" not in said and "damage" not in said, said)


def what_the_user_gets_wrong_is_said(test):
    out = test.work / "out"
    test.run("tether", "run", PAPER, "--set=run.duration_s=1", "--out", out, seconds=60)
    log = out / "run.lcmlog"
    view = test.start("tether", "view", log, "--port=0")
    _, port = address_of(view)
    empty = test.work / "empty.lcmlog"
    empty.touch()
    for command, code, words in (
        ((log, f"--port={port}"), 1, f"port {port} of 127.0.0.1 is taken; the next free one is "),
        ((PAPER,), 2, "paper.toml is not an LCM event log"),
        ((empty,), 2, "holds no message"),
        ((test.work / "nothing",), 2, "nothing"),
        ((log, "--address=0.0.0.0"), 2, "needs a token: --token"),
        ((log, "--address=0.0.0.0", "--token=short"), 2, "--token: has to be 16 to 128"),
        ((log, "--address=example.org", "--token=0123456789abcdef"), 2, "has to be an IP address in digits"),
        ((log, f"--page={test.work}"), 2, "has no index.html"),
        ((log, "--address=localhost"), 2, "has to be an IP address in digits: 127.0.0.1"),
        ((log, "--allow-origin=foo"), 2, "--allow-origin \"foo\": has to be what browsers call an origin"),
        ((log, "--allow-origin=https://app.foxglove.dev/"), 2, "without a path"),
        ((log, f"--scenario={PAPER}"), 2, "the scenario.toml beside it"),
        ((log, "--set=run.seed=1"), 2, "the scenario.toml beside it"),
        ((log, "--lcm-url=udpm://239.255.76.67:7667"), 2, "either a log"),
        (("--set=run.seed=1",), 2, "--scenario, which is missing"),
        ((out,), 2, "no sweep in"),
        (("--lcm-url=udpm://1.2.3.4:5",), 2, "not a multicast group"),
    ):
        refused = test.run("tether", "view", *command, seconds=10)
        said = refused.err().strip()
        check(refused.process.returncode == code, f"{command}: exit code {refused.process.returncode}: {said}")
        check(words in said and said.count("\n") == 0, f"{command}: {said}")
    far = test.run("tether", "view", log, "--port=99999", seconds=10)
    check(far.process.returncode == 2 and "--port: Value 99999 not in range 0 to 65535" in far.err(), far.err())
    live = test.run("tether", "live", PAPER, "--view", f"--port={port}", seconds=15)
    check(live.process.returncode == 1 and "tether view did not start" in live.err(), live.err())


def a_token_lets_in(test):
    out = test.work / "out"
    test.run("tether", "run", PAPER, "--set=run.duration_s=1", "--out", out, seconds=60)
    token = "a-secret-of-this-test"
    view = test.start("tether", "view", out / "run.lcmlog", "--port=0", "--address=0.0.0.0", f"--token={token}")
    wait_until(10, lambda: f"/?token={token}" in view.err(), "the address")
    address = address_of(view)
    check(address[0] == "127.0.0.1", f"{address} cannot be opened")
    check(http(address)[0] == 403 and http(address, "/api/run.json")[0] == 403, "no token, and let in")
    status, head, _ = http(address, f"/?token={token}")
    check(status == 200 and "HttpOnly; SameSite=Strict" in head, head)
    cookie = f"tether_view_{address[1]}={token}"
    check(http(address, "/api/run.json", Cookie=cookie)[0] == 200, "the cookie does not let in")
    Client(address, target=f"/?token={token}").close()
    Client(address, Cookie=cookie).close()


main(
    a_live_run_is_seen_and_its_network_set,
    an_unknown_network_is_seen,
    a_log_is_played,
    a_log_that_breaks_off_is_played_as_far_as_it_goes,
    a_computed_run_is_paced_and_the_same,
    a_fleet_is_seen_and_the_links_of_all_are_set,
    a_computed_run_ends_orderly_when_it_is_told_to,
    what_the_user_gets_wrong_is_said,
    a_token_lets_in,
)
