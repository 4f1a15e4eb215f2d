#!/usr/bin/env -S python3 -B
"""Two tether-link processes on hosts whose interfaces come late, go, come back, and carry less than was
said. Usage: interfaces_test.py BIN_DIR"""

import pathlib
import signal
import sys
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "live"))

from hosts import Host, veth  # noqa: E402
from live_support import TWIST, check, main, wait_until  # noqa: E402

PATHS = {"wifi": "10.77.0", "5g": "10.78.0"}


class Floor:
    """Two hosts, of which the near one has wlan7 for one path. Only the other path's cable is there."""

    def __init__(self, test):
        self.test = test
        self.near, self.far = Host(test), Host(test)
        self.network = {"near": self.near.network(), "far": self.far.network()}
        veth(self.near, "wwan7", self.far, "wwan7", PATHS["5g"])
        keys = {side: test.run("tether-link", "keygen", test.work / f"{side}.key").out().strip()
                for side in self.network}
        self.program = {side: self.start(side, keys) for side in self.network}
        self.sent = 0

    def start(self, side, keys):
        own, other = ("1", "2") if side == "near" else ("2", "1")
        peer = "far" if side == "near" else "near"
        paths = "".join(f"""
            [[path]]
            name = "{name}"
            bind = "{network}.{own}:7700"
            interface = "{'wlan7' if name == 'wifi' else 'wwan7'}"
            """ for name, network in PATHS.items())
        file = self.test.work / f"{side}.toml"
        file.write_text(f"""
            key = "{side}.key"
            report_period_s = 0.2
            {paths}
            [[peer]]
            name = "{peer}"
            public_key = "{keys[peer]}"
            addresses = [{", ".join(f'"{network}.{other}:7700"' for network in PATHS.values())}]
            send = ["CTRL/CMD_VEL"]
            receive = ["CTRL/CMD_VEL"]
            """)
        file.chmod(0o644)
        host = getattr(self, side)
        return self.test.start("/usr/bin/env", *host.enter, self.test.bin / "tether-link", "run", file)

    def plug_in(self):
        veth(self.near, "wlan7", self.far, "wlan7", PATHS["wifi"])

    def pull_out(self):
        self.near.shell("ip link del wlan7")

    def wait_alive(self, side, alive, what, seconds=8):
        def so():
            report = self.network[side].last("LINK/REPORT")
            return report and dict(zip(report.path, map(bool, report.path_alive))) == alive

        wait_until(seconds, so, what)

    def command_for(self, seconds):
        end = time.time() + seconds
        while time.time() < end:
            self.network["near"].send("CTRL/CMD_VEL", TWIST.encode(seq=self.sent))
            self.sent += 1
            time.sleep(0.01)

    def wait_said(self, side, words, seconds=5):
        wait_until(seconds, lambda: words in self.program[side].err(),
                   f'"{words}" of {side}: {self.program[side].err()}')


def a_path_lives_when_its_interface_comes_late_goes_and_comes_back(test):
    floor = Floor(test)
    one, both = {"wifi": False, "5g": True}, {"wifi": True, "5g": True}
    floor.wait_alive("near", one, "the path that has its interface")
    closed = 'path "wifi" is closed, and tried again each second: cannot use interface "wlan7"'
    floor.wait_said("near", closed)
    begin = time.time()
    commands = threading.Thread(target=floor.command_for, args=(9,))
    commands.start()
    floor.plug_in()
    floor.wait_alive("far", both, "both paths, once the interface has come")
    test.say(f"alive {time.time() - begin:.1f} s after its interface came")
    floor.pull_out()
    floor.wait_alive("far", one, "the path that is left")
    floor.plug_in()
    again = time.time()
    floor.wait_alive("far", both, "both paths again")
    test.say(f"alive {time.time() - again:.1f} s after it came back")
    commands.join()
    time.sleep(0.3)
    heard = sorted(m.seq for m in floor.network["far"].messages("CTRL/CMD_VEL"))
    check(heard == list(range(floor.sent)), f"{len(heard)} of {floor.sent} commands came")
    said = floor.program["near"].err()
    check(said.count(closed) == 2 and said.count('path "wifi" on 10.77.0.1:7700') == 2, said)

    # Sizes that a network drops silently: the far end takes less than the near one may send.
    floor.far.shell("ip link set wlan7 mtu 900")
    for side in ("near", "far"):
        floor.wait_said(side, "wifi does not carry packets of 1400 bytes: set a smaller mtu, on both hosts", 20)
    for side, program in floor.program.items():
        program.kill(signal.SIGINT)
        check(program.wait(5) == 0, program.err())
        test.say(f"{side} said:\n" + program.err())


main(a_path_lives_when_its_interface_comes_late_goes_and_comes_back)
