#!/usr/bin/env -S python3 -B
"""`tether-vehicle metrics` is scraped over HTTP while a bridge drives, a controller decides and a link runs: all that it
serves is read twice, after the format's specification and by Prometheus' own client library, and compared with what the
nodes themselves say on LCM. Usage: metrics_test.py BIN_DIR"""

import http.client
import pathlib
import re
import socket
import sys
import time
import urllib.parse

from prometheus_client.parser import text_string_to_metric_families

sys.path.insert(1, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
from can_drivetrain import Drivetrain, patient_file
from live_support import COUNTERS, GROUP, PAPER, PORT, SOURCE, TYPES, LcmType, Network, check, main, wait_until
from prometheus_text import parse

FAR_PORT = 7668
PAGE = (SOURCE / "docs/howto/deployment.md").read_text()
TOKEN = "0123456789abcdef-token"
TYPES["LINK/REPORT"] = LcmType("peer_report")


class Exporter:
    def __init__(self, test, *options):
        self.program = test.start("tether-vehicle", "metrics", "--port", 0, *options)
        url = wait_until(5, lambda: self.program.out().strip(), "its address")
        self.port = urllib.parse.urlsplit(url).port

    def get(self, path="/metrics", method="GET", **headers):
        """Status, media type, text."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=5)
        connection.request(method, path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.getheader("Content-Type"), answer.read().decode()

    def scrape(self):
        """All samples, on which both parsers agree."""
        status, kind, text = self.get()
        check(status == 200 and kind == "text/plain; version=0.0.4; charset=utf-8", (status, kind))
        samples, kinds = parse(text)
        theirs = {}
        for family in text_string_to_metric_families(text):
            for sample in family.samples:
                theirs[sample.name, frozenset(sample.labels.items())] = sample.value
                name = family.name + "_total" * (family.type == "counter")
                check(kinds.get(sample.name) == family.type and sample.name == name, f"{sample}: {family.type}")
        check(repr(sorted(map(str, theirs.items()))) == repr(sorted(map(str, samples.items()))), "two readings differ")
        return Samples(samples)


class Samples:
    def __init__(self, samples):
        self._samples = samples

    def names(self):
        return {name for name, _ in self._samples}

    def kinds(self):
        """Names with the names of their labels."""
        return {(name, frozenset(dict(labels))) for name, labels in self._samples}

    def get(self, name, **labels):
        """None if it is absent."""
        return self._samples.get((name, frozenset(labels.items())))

    def all(self, name):
        return {labels: value for (of, labels), value in self._samples.items() if of == name}


def link(test, side, lcm_port, udp_port, peer_port, keys):
    other = {"control": "agv1", "agv1": "control"}[side]
    rules = {"control": 'send = []\nreceive = ["CTRL/POSE"]', "agv1": 'send = ["AGV/POSE -> CTRL/POSE"]\nreceive = []'}
    file = test.work / f"{side}.toml"
    file.write_text(f"""
        key = "{side}.key"
        lcm_url = "udpm://{GROUP}:{lcm_port}?ttl=0"
        report_period_s = 0.2
        [[path]]
        name = "wifi"
        bind = "127.0.0.1:{udp_port}"
        [[peer]]
        name = "{other}"
        public_key = "{keys[other]}"
        addresses = ["127.0.0.1:{peer_port}"]
        {rules[side]}
        """)
    file.chmod(0o644)
    return test.start("tether-link", "run", file)


def two_links(test):
    keys = {side: test.run("tether-link", "keygen", test.work / f"{side}.key").out().strip() for side in ("control", "agv1")}
    own = link(test, "agv1", PORT, 7700, 7710, keys)
    return own, link(test, "control", FAR_PORT, 7710, 7700, keys)


def what_was_never_heard_is_absent(test):
    exporter = Exporter(test)
    names = exporter.scrape().names()
    check(all(name.startswith(("tether_metrics_", "tether_build_")) for name in names), names)


def a_scrape_says_what_the_nodes_say(test):
    """And goes on to say it, with its age, of those that have ended."""
    exporter = Exporter(test)
    _, far = two_links(test)
    with Drivetrain(test, patient_file(test)) as d:
        d.bring_up(0.5)
        controller = test.start("tether-controller", PAPER, "--start-utime", d.start_utime, "--set", "controller.trigger=timer")
        network = test.network
        wait_until(10, lambda: (r := network.last("LINK/REPORT")) and r.up and r.offset_known, "the link is up")
        d.counters(), wait_until(5, lambda: network.last("CTRL/REPORT"), "the controller decides")
        time.sleep(1.2)  # a report of counters of each

        before, state_before = d.counters(), d.state()
        samples = exporter.scrape()
        after = d.counters()
        check(samples.get("tether_drivetrain_state", vehicle="AGV", state_name="armed") == 1, samples.all("tether_drivetrain_state"))
        check(len(samples.all("tether_drivetrain_state")) == 1, samples.all("tether_drivetrain_state"))
        check(samples.get("tether_drivetrain_bus", vehicle="AGV", bus="up") == 1, samples.all("tether_drivetrain_bus"))
        speed = samples.get("tether_drivetrain_speed_setpoint_meters_per_second", vehicle="AGV")
        check(abs(speed - state_before.v_mps) < 1e-6, (speed, state_before.v_mps))
        age = samples.get("tether_drivetrain_command_age_seconds", vehicle="AGV")
        check(0 <= age < 0.5, f"command age {age}")
        check(samples.get("tether_controller_pose_age_seconds", vehicle="AGV") is None, "an age of no pose")

        nodes = {}
        for labels, value in samples.all("tether_node_events_total").items():
            labels = dict(labels)
            nodes.setdefault(labels["node"], {})[labels["event"]] = value
        programs = {"tether-can-bridge", "tether-can-drive", "tether-controller"}  # on RUN/LOOP
        check(nodes.keys() == {"can_bridge", "controller", "drive"} | programs, nodes.keys())
        bridge = nodes["can_bridge"]
        check(set(before) - {"loop.slips"} == set(bridge), f"{set(before) ^ set(bridge)}")
        outside = {name: (before[name], value, after[name]) for name, value in bridge.items() if not before[name] <= value <= after[name]}
        check(not outside, f"counters of the bridge: {outside}")
        check(len(samples.all("tether_loop_slips_total")) == len(nodes), samples.all("tether_loop_slips_total"))

        report = network.last("LINK/REPORT")
        check(samples.get("tether_link_up", peer="control") == 1, "the link")
        check(samples.get("tether_link_sessions_total", peer="control") == report.sessions, "sessions")
        low, high = (samples.get(f"tether_link_clock_offset_{end}_seconds", peer="control") for end in ("min", "max"))
        check(-0.1 < low <= 0.0 <= high < 0.1, f"one clock, and it is between {low} and {high} s ahead of itself")
        received = samples.get("tether_link_path_datagrams_received_total", peer="control", path="wifi")
        check(0 < received <= network.last("LINK/REPORT").path_received[0], received)
        served = exporter.scrape().get("tether_channel_messages_total", channel="CAN/STATE")
        heard = len(network.messages("CAN/STATE"))
        time.sleep(1.0)
        served = exporter.scrape().get("tether_channel_messages_total", channel="CAN/STATE") - served
        heard = len(network.messages("CAN/STATE")) - heard
        check(heard > 30 and abs(served - heard) < 10, f"{served} CAN/STATE were served, {heard} heard")

        shown = {(name, frozenset(re.findall(r'(\w+)="', labels))) for name, labels in re.findall(r"(?m)^    (tether_\w+)\{(.*)\}", PAGE)}
        check(len(shown) >= 8, f"of deployment.md: {shown}")
        wait_until(10, lambda: shown <= exporter.scrape().kinds(), "what deployment.md shows is served, with those labels")

        since = time.time()
        far.kill()
        controller.kill()
        d.bridge.kill(9)
        d.bridge.wait(5)
        gone = time.monotonic()
        wait_until(5, lambda: exporter.scrape().get("tether_link_up", peer="control") == 0, "the link is down")
        check(time.time() - since < 3, f"the link was seen down after {time.time() - since:.1f} s")
        time.sleep(2.0)
        stale = exporter.scrape()
        passed = time.monotonic() - gone
        check(stale.get("tether_drivetrain_state", vehicle="AGV", state_name="armed") == 1, "the last state")
        for name, labels in (("tether_channel_age_seconds", {"channel": "CAN/STATE"}),
                             ("tether_drivetrain_command_age_seconds", {"vehicle": "AGV"})):
            age = stale.get(name, **labels)
            check(abs(age - passed) < 0.7, f"{name} {age} after {passed} s")
        age = stale.get("tether_link_age_seconds", peer="control")
        check(2 < age < passed + 2, f"the peer's newest datagram is {age} s old")
        check(stale.get("tether_link_report_age_seconds", peer="control") < 1, "the link itself still reports")
        test.say(f"{len(samples._samples)} samples of {len(samples.names())} names, {len(nodes)} nodes")


def whatever_is_sent_every_line_can_be_read(test):
    exporter = Exporter(test)
    names = ['a"b', "a\\", "a\nb", "a\x7f", "", "# TYPE x counter", '"} 1', "a,b=\"c\"", "ä", "x" * 5000]
    for i, name in enumerate(names):
        test.network.send("SIM/COUNTERS", COUNTERS.encode(node=name, count=2, name=[name, name], value=[1, -(2**63)], seq=i))
        if name:
            test.network.send(name[:60] + "/COUNTERS", COUNTERS.encode(node="n", count=0))
    wrong = COUNTERS.encode(node="QQQQ", count=1, name=["w"], value=[3]).replace(b"QQQQ", b"\xff\xfe\xc3\x28")
    test.network.send("SIM/COUNTERS", wrong)
    test.network.send("SIM/COUNTERS", wrong[:-1])
    wait_until(5, lambda: any("\\xff" in dict(k)["node"] for k in exporter.scrape().all("tether_node_events_total")), "the last")
    samples = exporter.scrape()
    check(len(samples.all("tether_node_events_total")) == len(names) + 1, samples.all("tether_node_events_total"))
    for i in range(3000):
        test.network.send(f"INVENTED{i}", b"")
        if i % 100 == 0:
            time.sleep(0.02)
    wait_until(10, lambda: exporter.scrape().get("tether_metrics_messages_ignored_total") > 1900, "most are ignored")
    check(len(exporter.scrape().all("tether_channel_age_seconds")) == 1000, "channels")


def it_serves_this_host_alone_unless_a_token_is_given(test):
    exporter = Exporter(test)
    check(exporter.get("/")[0] == 404 and exporter.get("/../etc/passwd")[0] == 404, "other paths")
    check(exporter.get(method="POST")[0] == 405, "POST")
    check(exporter.get(Host="evil.example")[0] == 403, "another host's name")
    check(exporter.get(Origin="http://evil.example")[0] == 403, "a page from elsewhere")
    connection = socket.create_connection(("127.0.0.1", exporter.port))
    connection.sendall(b"\0garbage\r\n\r\n")
    check(b" 400 " in connection.recv(1000), "garbage")
    test.network.send("SIM/COUNTERS", COUNTERS.encode(node="sim"))
    wait_until(5, lambda: exporter.scrape().get("tether_channel_messages_total", channel="SIM/COUNTERS"), "it goes on")

    for options, what in ((("--address", "0.0.0.0"), "--token"), (("--address", "host"), "address \"host\""),
                          (("--token", "short"), "--token: has to be 16 to 128"), (("--port", 70000), "--port"),
                          (("--lcm-url", "nonsense"), "nonsense")):
        refused = test.run("tether-vehicle", "metrics", *options)
        check(refused.process.returncode == 2 and what in refused.err(), refused.err())
    taken = test.run("tether-vehicle", "metrics", "--port", exporter.port)
    check(taken.process.returncode == 1 and "is taken" in taken.err(), taken.err())

    open_to_all = Exporter(test, "--address", "0.0.0.0", "--token", TOKEN)
    check(open_to_all.get()[0] == 403, "without a token")
    check(open_to_all.get("/metrics?token=0123456789abcdef-tokeN")[0] == 403, "a wrong token")
    check(open_to_all.get(f"/metrics?token={TOKEN}", Host="agv1:9765")[0] == 200, "with the token, by any name")
    exporter.program.kill(15)
    check(exporter.program.wait(5) == 0, exporter.program.err())


main(
    what_was_never_heard_is_absent,
    a_scrape_says_what_the_nodes_say,
    whatever_is_sent_every_line_can_be_read,
    it_serves_this_host_alone_unless_a_token_is_given,
)
