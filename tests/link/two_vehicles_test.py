#!/usr/bin/env -S python3 -B
"""Two vehicles and one control host, as docs/howto/deployment.md sets them up: three network namespaces, one link
with two peers, and the controllers by the command line of tether-controller@.service. The vehicles are simulated,
each with a run number of its own. Usage: two_vehicles_test.py BIN_DIR"""

import pathlib
import re
import signal
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "live"))

from hosts import Host, veth  # noqa: E402
from live_support import PAPER, SOURCE, TWIST, TYPES, check, main, wait_until  # noqa: E402

VEHICLES = {"AGV1": "192.0.2", "AGV2": "198.51.100"}
TYPES |= {"AGV1/CMD_VEL": TWIST, "AGV2/CMD_VEL": TWIST, "CTRL1/CMD_VEL": TWIST, "CTRL2/CMD_VEL": TWIST}
PAGE = (SOURCE / "docs/howto/deployment.md").read_text()
ONE, TWO = PAGE.partition("### Two vehicles, one control host")[::2]


def line_of(name, part):
    """The line of the page: send and receive of that host."""
    line = re.search(rf"(?m)^ +{name}: +(send = .*?\]) +(receive = .*)$", part)
    check(line, f"no rules of {name} in the page")
    return line


def rules(name, vehicle):
    """The same, as the file of the link has them."""
    line = line_of(name, TWO)
    return "\n".join(line.groups()).replace("AGV1", vehicle).replace("CTRL1", f"CTRL{vehicle[3:]}").replace(
        "CAN1", f"CAN{vehicle[3:]}")


def controller_command(vehicle):
    unit = (SOURCE / "systemd/tether-controller@.service").read_text()
    return re.search(r"(?m)^ExecStart=/usr/bin/(.*?)(?: --lock-memory)?$", unit)[1].replace("%i", vehicle).split()


class Side:
    """A host with a link."""

    def __init__(self, test, name):
        self.test, self.name = test, name
        self.host = Host(test)
        self.network = self.host.network()
        self.key = test.run("tether-link", "keygen", test.work / f"{name}.key").out().strip()

    def start(self, *command):
        return self.test.start("/usr/bin/env", *self.host.enter, self.test.bin / command[0], *command[1:])

    def start_link(self, peers):
        """peers: name, key, address, rules."""
        file = self.test.work / f"{self.name}.toml"
        file.write_text(f'key = "{self.name}.key"\n[[path]]\nname = "wifi"\nbind = "0.0.0.0:7700"\n' + "".join(
            f'[[peer]]\nname = "{name}"\npublic_key = "{key}"\naddresses = ["{address}:7700"]\n{text}\n'
            for name, key, address, text in peers))
        file.chmod(0o644)
        return self.start("tether-link", "run", file)


def both_drive_and_neither_hears_the_other(test):
    control = Side(test, "control")
    vehicles = {name: Side(test, name) for name in VEHICLES}
    for name, side in vehicles.items():
        veth(control.host, f"to{name}", side.host, "wlan0", VEHICLES[name])
    links = [control.start_link([(name, side.key, f"{VEHICLES[name]}.2", rules("control", name))
                                 for name, side in vehicles.items()])]
    links += [side.start_link([("control", control.key, f"{VEHICLES[name]}.1", rules("AGV1", name))])
              for name, side in vehicles.items()]
    for link in links:
        wait_until(15, lambda link=link: link.err().count("up, by wifi") == (2 if link is links[0] else 1), "links are up")
    numbers = {}
    for i, (name, side) in enumerate(vehicles.items()):
        numbers[name] = int(time.time() * 1e6) + i
        settings = ("--set", "sensor.rate_hz=20", "--start-utime", numbers[name])
        side.start("tether-sim", PAPER, "--set", f"vehicle.name={name}", *settings)
        environment = {"TETHER_SCENARIO": PAPER, "TETHER_START_UTIME": numbers[name]}
        command = [str(environment[word[2:-1]]) if word.startswith("${") else word for word in controller_command(name)]
        control.start(*command, "--set", "sensor.rate_hz=20")
    for name, side in vehicles.items():
        own, other = f"{name}/CMD_VEL", f"{'AGV2' if name == 'AGV1' else 'AGV1'}/CMD_VEL"
        wait_until(15, lambda side=side, own=own: len(side.network.messages(own)) > 60, f"{name} is commanded")
        check({m.run for m in side.network.messages(own)} == {numbers[name]}, f"{name}: another run's commands")
        check(not side.network.messages(other), f"{name} hears {other}")
        check(max(abs(m.v_mps) for m in side.network.messages(own)) > 0.1, f"{name} drives")
        foreign = {channel for channel in side.network.channels() if channel.startswith(("AGV", "CTRL"))}
        check(all(channel.startswith(f"{name}/") for channel in foreign), f"{name} hears {foreign}")
    test.say(", ".join(f"{name}: {len(side.network.messages(name + '/CMD_VEL'))} commands of its own controller"
                       for name, side in vehicles.items()))
    for link in links:
        link.kill(signal.SIGINT)
        check(link.wait(5) == 0, link.err())
    for side in (control, *vehicles.values()):
        side.network.close()


def one_vehicle_by_the_rules_of_the_first_metre(test):
    control, vehicle = Side(test, "control"), Side(test, "vehicle7")
    veth(control.host, "wlan0", vehicle.host, "wlan0", "192.0.2")
    links = [near.start_link([(far.name, far.key, address, "\n".join(line_of(rule, ONE).groups()))])
             for near, far, address, rule in ((control, vehicle, "192.0.2.2", "control"), (vehicle, control, "192.0.2.1", "vehicle"))]
    for link in links:
        wait_until(15, lambda link=link: link.err().count("up, by wifi") == 1, "links are up")
    settings = (PAPER, "--set", "sensor.rate_hz=20", "--start-utime", int(time.time() * 1e6))
    vehicle.start("tether-sim", *settings)
    control.start("tether-controller", *settings)
    wait_until(15, lambda: len(vehicle.network.messages("AGV/CMD_VEL")) > 60, "it is commanded")
    check(max(abs(m.v_mps) for m in vehicle.network.messages("AGV/CMD_VEL")) > 0.1, "it drives")
    echo = vehicle.start("tether-vehicle", "echo", "CAN/REQUEST")
    control.start("tether-vehicle", "can", "estop")
    wait_until(10, lambda: "CAN/REQUEST drive_request_t" in echo.out(), "the operator's request arrives")
    check("SIM/TRUTH" in vehicle.network.channels() and "SIM/TRUTH" not in control.network.channels(), "only what is named")
    test.say(f"one vehicle: {len(vehicle.network.messages('AGV/CMD_VEL'))} commands, and the e-stop")
    for link in links:
        link.kill(signal.SIGINT)
        check(link.wait(5) == 0, link.err())
    for side in (control, vehicle):
        side.network.close()


main(both_drive_and_neither_hears_the_other, one_vehicle_by_the_rules_of_the_first_metre)
