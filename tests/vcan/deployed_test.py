#!/usr/bin/env -S python3 -B
"""The vehicle's package as installed on a booted system, with `can.emulate_drives = false` and drives that were
written from the standard alone, by the commands of docs/howto/deployment.md: commissioned, started, armed,
driven, stopped, killed, released and driven again. Usage: deployed_test.py BIN_DIR"""

import re
import time
import urllib.request

from booted import Booted
from can_drivetrain import STANDING_MPS, changed_file, patient_file
from can_drivetrain import SCENARIO as HIL
from independent_drivetrain import Independent
from live_support import SOURCE, check, main, wait_until

PAGE = (SOURCE / "docs/howto/deployment.md").read_text()
SETTINGS = "sudo install -D -m 644 /usr/share/tether/systemd/tether.env"
BRIDGE = "tether-can-bridge.service"
SPEED_MPS = 0.3


def commands_of_the_page(first):
    """From the one that begins so to the end of its block; there is no sudo here."""
    block = re.search(rf"(?m)^    {re.escape(first)}.*(?:\n    .*)*", PAGE)
    check(block, f"deployment.md has no {first!r}")
    as_tether = "setpriv --reuid=tether --regid=tether --clear-groups env "
    return [line.strip().removeprefix("$ ").replace("sudo -u tether ", as_tether).replace("sudo ", "") for line in block[0].splitlines()]


def served_metrics():
    with urllib.request.urlopen("http://127.0.0.1:9765/metrics", timeout=5) as answer:
        return answer.read().decode()


class Deployed(Independent):
    def __init__(self, test):
        super().__init__(test, drivetrain=patient_file(test))  # booting a guest makes it late
        scenario = changed_file(test, "vehicle.toml", HIL, ("../drivetrains/two_node_cia402.toml", "drives.toml"),
                                ("[can]\n", '[can]\nemulate_drives = false\narm = "never"\n'),
                                ("stale_ms = 200.0", "stale_ms = 1000.0"), ("disarm_ms = 500.0", "disarm_ms = 2000.0"))
        self.system = Booted(test, test.bin, for_packages=True)
        self.system.start(test)
        self.system.install("now")
        for name, text in (("vehicle.toml", scenario.read_text()), ("drives.toml", self.drivetrain.read_text())):
            file = self.system.root / "etc/tether" / name
            file.write_text(text)
            file.chmod(0o644)
        (self.system.root / "etc/systemd/network").mkdir()  # Debian's systemd has it
        self.follow(SETTINGS, slice(3))  # vcan0 is there, without udev

    def follow(self, first, lines=slice(None)):
        """Does what the page says there."""
        for command in commands_of_the_page(first)[lines]:
            self.test.say(f"$ {command}")
            said = self.system.run("sh", "-c", command)
            check("PROBLEM" not in said, said)

    def can(self, *words):
        """A command of the vehicle's operator: what it says."""
        return self.system.run("tether-vehicle", "can", *words)

    def begin_driving(self):
        """Begins the guide's first metre; returns the program that commands it."""
        program = self.test.start(*self.system.inside("tether-vehicle", "can", "drive", "--v-mps", SPEED_MPS, "--for-s", 60))
        wait_until(10, lambda: "waiting for" in program.out(), "zero is commanded")
        wait_until(10, lambda: "ready to be armed" in self.state().reason, "the drives are compared with the record")
        self.can("arm")
        self._wait(10, lambda: min(self.rims_mps()[-1][1:]) > 0.95 * SPEED_MPS, "it drives")
        return program

    def release(self):
        self.can("release")
        time.sleep(1)  # same as on the page: standstill is confirmed
        self.can("reset")
        self.wait_state("disarmed", 20)

    def restarts(self):
        return int(self.system.show(BRIDGE, "NRestarts"))

    def kill_bridge(self):
        before, killed = self.restarts(), time.time()
        self.system.run("kill", "-KILL", self.system.show(BRIDGE, "MainPID"))
        wait_until(15, lambda: self.restarts() > before and self.system.show(BRIDGE, "ActiveState") == "active",
                   "the bridge is up again")
        return killed


def real_drives_from_the_first_start_on(test):
    with Deployed(test) as agv:
        agv.follow("$ sudo systemctl enable --now tether-metrics", slice(1))  # starting it makes a guest late
        agv.follow(SETTINGS, slice(4, 5))
        for unit in ("systemd-networkd", "tether-logger", "tether-can-bridge"):
            check(agv.system.show(f"{unit}.service", "ActiveState") == "active", f"{unit} runs")
        agv.follow("sudo systemctl stop tether-can-bridge")
        check(any("did not exist" in m.reason for m in agv.network.messages("CAN/STATE")), "it began with the e-stop pressed")
        agv.wait_state("disarmed", 20)
        links = agv.system.show("tether-can-links.service", "ActiveState")
        check(links == "active", f"what restarts the bridge's interface is {links}")
        wait_until(20, lambda: 'tether_drivetrain_state{vehicle="AGV",state_name="disarmed"} 1\n' in served_metrics(), "metrics")
        driving = agv.begin_driving()
        test.say("commissioned, started, released, armed, driving")

        asked = time.time()
        agv.can("estop")
        agv.check_stopped(asked)
        agv.wait_state("estop", 5, asked, "release it")
        driving.wait(10)
        check('tether_drivetrain_state{vehicle="AGV",state_name="estop"} 1\n' in served_metrics(), "metrics of the e-stop")
        killed = agv.kill_bridge()
        agv.wait_state("estop", 20, killed, "latched when the bridge ended")
        refused = agv.system.run("tether-vehicle", "can", "arm", check_it=False)
        check("estop" in refused and agv.state().state_name == "estop", refused)
        moved = [rims for rims in agv.rims_mps(killed) if max(map(abs, rims[1:])) > STANDING_MPS]
        check(not moved, f"wheels turned: {moved[:1]}")
        test.say("stopped, killed, restarted, still latched")

        agv.release()
        agv.begin_driving()
        killed = agv.kill_bridge()
        agv.wait_for_standstill()
        agv.wait_state("estop", 20, killed, "has no proof of a clean end")
        test.say("released and driven again; killed at speed, it stopped and starts with the e-stop pressed")


main(real_drives_from_the_first_start_on)
