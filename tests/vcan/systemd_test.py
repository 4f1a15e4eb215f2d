#!/usr/bin/env -S python3 -B
"""The CAN bridge as a service of a booted system: up when it can work, restarted however it ends, never
armed by itself, stopped with the wheels at rest. Usage: systemd_test.py BIN_DIR"""

import pathlib
import re
import shutil
import signal
import subprocess
import tempfile
import time

from booted import HARDENING, UNITS, Booted
from can_drivetrain import NODES, SCENARIO, TWO_NODES, Drivetrain, changed_file, moves, patient_file, rpdo1
from can_support import CanBus, SerialAdapter, bridged, create_vcan, ip
from live_support import SOURCE, check, main, wait_until

BRIDGE = "tether-can-bridge.service"
RPDOS = tuple(map(rpdo1, NODES))
CAN_ERR_BUSOFF = 0x20000040
SPEED_MPS = 0.5
LINKS = "tether-can-links.service"
MOST_EXPOSED = {"tether-host": 1.7}  # root, with CAP_NET_ADMIN for a route


class Served(Drivetrain):
    """With a bridge that systemd keeps."""

    settings = ("can.stale_ms=1000", "can.disarm_ms=2000")

    def __init__(self, test, interface="vcan0"):
        super().__init__(test, patient_file(test))
        scenario = changed_file(test, "vehicle.toml", SCENARIO,
                                ("../drivetrains/two_node_cia402.toml", str(self.drivetrain)),
                                ("[can]\n", '[can]\nwheels = "model"\n'),
                                ('interface = "vcan0"', f'interface = "{interface}"'),
                                ("stale_ms = 200.0", "stale_ms = 1000.0"),
                                ("disarm_ms = 500.0", "disarm_ms = 2000.0"))
        self.system = Booted(test, test.bin)
        self.scenario = self.system.root / scenario.relative_to("/")
        for file in (scenario, self.drivetrain):
            target = self.system.root / file.relative_to("/")
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(file.read_text())
        self.system.configure(TETHER_SCENARIO=scenario, TETHER_START_UTIME=self.start_utime,
                              LCM_DEFAULT_URL=self.network.url, TETHER_RECORD='"--keep-free-mb 10"')
        self.system.start(test)

    def start_bridge(self, wait=True):
        self.system.ctl("start", BRIDGE)

    def process(self):
        return int(self.system.show(BRIDGE, "MainPID"))

    def restarts(self):
        return int(self.system.show(BRIDGE, "NRestarts"))

    def kill(self, name):
        """When."""
        now = time.time()
        self.system.run("kill", f"-{name}", self.process())
        return now

    def wait_restart(self, before, seconds):
        def again():
            return self.restarts() > before and self.system.show(BRIDGE, "ActiveState") == "active"

        wait_until(seconds, again, f"restart {before + 1} of the bridge")


def bridge_as_a_service(test):
    with Served(test) as d:
        # Nothing answers on the bus: it works all the same, and says so.
        d.start_drives()
        d.start_bridge()
        check(d.system.show(BRIDGE, "StatusText").startswith("running on udpm"), d.system.show(BRIDGE, "StatusText"))
        with open(f"/proc/{outer_pid(d)}/status", encoding="ascii") as status:
            kept = dict(line.strip().split(":\t", 1) for line in status if ":\t" in line)
        check(int(kept["CapEff"], 16) == int(kept["CapBnd"], 16) == 0, f"capabilities: {kept['CapBnd']}")
        check(kept["NoNewPrivs"] == "1" and kept["Seccomp"] == "2" and kept["Uid"].split()[0] != "0", str(kept))
        check(int(kept["VmLck"].split()[0]) > 1000, f"memory is not locked: {kept['VmLck']}")
        policy = subprocess.run(["chrt", "--pid", str(outer_pid(d))], capture_output=True, text=True, check=True).stdout
        check("SCHED_FIFO" in policy and "50" in policy, policy)
        d.arm()
        test.say("up, as user tether without capabilities; armed")
        the_interface_is_restarted_for_it(d, test)

        # However it ends, the wheels come to rest, it restarts, and never arms by itself.
        for name, seconds in (("KILL", 10), ("SEGV", 10), ("STOP", 12), ("KILL", 10)):
            d.drive(SPEED_MPS)
            before, when = d.restarts(), d.kill(name)
            rest = d.wait_standstill(when)
            d.wait_restart(before, seconds)
            d.wait_state("disarmed", 15, when)
            check("armed" not in d.states(rest), f"SIG{name}: armed again: {d.states(rest)}")
            d.check_still(max(rest, time.time() - 0.5), f"after SIG{name}")
            test.say(f"SIG{name}: at rest after {rest - when:.2f} s, up again, disarmed")
            d.arm()

        # Stopped in good order: wheels at rest and drives off before it ends.
        d.drive(SPEED_MPS)
        when = time.time()
        d.system.ctl("stop", BRIDGE)
        ended = time.time()
        rest = d.wait_standstill(when)
        check(rest <= ended + 0.1, f"it ended {rest - ended:.2f} s before the wheels were at rest")
        check(d.system.show(BRIDGE, "Result") == "success", d.system.show(BRIDGE, "Result"))
        wait_until(10, lambda: d.system.show(LINKS, "ActiveState") == "inactive", f"{LINKS} ends with the bridge")
        test.say(f"stopped in {ended - when:.2f} s, at rest after {rest - when:.2f} s")
        with_real_drives_it_remembers_the_estop(d)
        the_others_run_too(d, test)


def the_interface_is_restarted_for_it(d, test):
    """By tether-can-links, also by one that had to be started again."""
    for number in (1, 2):
        when = time.time()
        subprocess.run(["cansend", "vcan0", f"{CAN_ERR_BUSOFF:08X}#{'00' * 8}"], check=True)
        d.wait_state("fault", 5, when, "CAN bus-off")
        reset = d.request("reset")
        d.wait_state("disarmed", 15, reset)
        restarts = d.counters()["can.restarts"]
        check(restarts == number, f"{restarts} restarts of vcan0")
        d.arm()
        if number == 1:
            before = int(d.system.show(LINKS, "NRestarts"))
            d.system.run("kill", "-KILL", d.system.show(LINKS, "MainPID"))
            wait_until(10, lambda: int(d.system.show(LINKS, "NRestarts")) > before and
                       d.system.show(LINKS, "ActiveState") == "active", f"{LINKS} again")
            check(d.states(reset)[-1] == "armed" and d.restarts() == 0, "the bridge needs it for a restart only")
    test.say("the interface is restarted by tether-can-links, also after it was killed")


def a_serial_adapter_stalls(test):
    """It takes no more frames, and neither commands to close and open, for each of which its driver waits a second."""
    adapter = SerialAdapter("can0")
    try:
        with CanBus() as far, Served(test, "can0") as d:
            bridged(adapter, far)
            try:
                the_queue_is_emptied_for_it(d, adapter, test)
            finally:
                adapter.on_frame = lambda text: None
                adapter.stall(False)
    finally:
        adapter.close()


def the_queue_is_emptied_for_it(d, adapter, test):
    d.start_drives()
    d.start_bridge()
    d.arm()
    d.drive(SPEED_MPS)
    stall, adapter_stalls_s = time.time(), 5
    adapter.stall()
    d.wait_for("CAN/STATE", lambda m: "restarting can0 failed (Connection timed out)" in m.reason, 10, "it gives up", stall)
    stand = d.wait_standstill(stall)
    time.sleep(stall + adapter_stalls_s - time.time())
    heard = [m.arrival for m in d.network.messages("CAN/STATE", stall)]
    silent = max(b - a for a, b in zip(heard, heard[1:]))
    ran_on = (d.restarts(), d.system.show(LINKS, "NRestarts"))
    check(ran_on == (0, "0"), f"restarts of the bridge and of {LINKS}: {ran_on}")
    go_on = time.time()
    adapter.stall(False)
    reset = d.request("reset")
    d.wait_state("disarmed", 30, reset)
    time.sleep(0.5)
    # The adapter had one frame already: whatever the bridge does, that one goes out.
    taken = next(arrival for arrival, _ in adapter.frames if arrival > go_on)
    setpoints = list(adapter.setpoints(RPDOS, taken))
    moving = [f for f in setpoints if moves(f)]
    check(len(setpoints) > 10 and not moving, f"{len(moving)} of {len(setpoints)} setpoints are of before the stall")
    d.arm()
    check(d.restarts() == 0, "the bridge ran on")
    test.say(f"serial adapter stalled at {SPEED_MPS} m/s for {adapter_stalls_s} s: wheels stand after {stand - stall:.2f} s, bridge "
             f"silent for {silent:.1f} s and not restarted; after RESET {len(setpoints)} setpoints, none of before")


def with_real_drives_it_remembers_the_estop(d):
    text = d.scenario.read_text().replace("[can]\n", '[can]\nemulate_drives = false\narm = "never"\n')
    d.scenario.write_text(text)
    since = time.time()
    d.start_bridge()
    d.wait_state("estop", 15, since, '"/var/lib/tether/estop.AGV.vcan0" did not exist')
    d.system.ctl("stop", BRIDGE)
    check((d.system.root / "var/lib/tether/estop.AGV.vcan0").stat().st_size == 512, "the e-stop's file")


def the_others_run_too(d, test):
    """Controller, logger and page, as the same user and with no rights at all. Not beside the bridge: starting them makes a guest late."""
    others = [f"tether-{name}.service" for name in ("controller", "logger", "view")]
    d.system.ctl("start", *others)
    time.sleep(3)
    for unit in others:
        check(d.system.show(unit, "ActiveState") == "active" and d.system.show(unit, "NRestarts") == "0",
              d.system.ctl("status", unit, check_it=False))
    before = int(d.system.show(others[0], "NRestarts"))
    d.system.run("kill", "-STOP", d.system.show(others[0], "MainPID"))
    wait_until(12, lambda: int(d.system.show(others[0], "NRestarts")) > before, "the controller's watchdog")
    d.system.ctl("stop", *others)
    recorded = sum(file.stat().st_size for file in (d.system.root / "var/lib/tether").glob("floor-*.lcmlog"))
    check(recorded > 10_000, f"{recorded} bytes recorded")
    test.say(f"controller, logger ({recorded} bytes) and page run; a stopped controller is restarted")


def the_bridge_follows_its_adapter(test):
    """With bind-can0.conf as shipped, and udev as it is: an interface can0 that comes, goes and comes again."""
    system = Booted(test, test.bin)
    scenario = system.root / "etc/tether/vehicle.toml"
    text = SCENARIO.read_text().replace('interface = "vcan0"', 'interface = "can0"')
    check('interface = "can0"' in text, "the scenario names its interface")
    scenario.write_text(text.replace("../drivetrains/two_node_cia402.toml", "drives.toml"))
    shutil.copy(TWO_NODES, scenario.with_name("drives.toml"))
    system.configure(TETHER_SCENARIO="/etc/tether/vehicle.toml", LCM_DEFAULT_URL=test.network.url)
    page = (SOURCE / "docs/howto/deployment.md").read_text()
    command = re.search(r"(?m)^    sudo (install .*)/usr/share/tether/systemd/(bind-can0.conf) (/etc/\S+)$", page)
    check(command, "deployment.md does not install bind-can0.conf")
    subprocess.run([*command[1].split(), UNITS / command[2], f"{system.root}{command[3]}"], check=True)
    system.start(test)
    system.ctl("start", "systemd-udevd")
    system.ctl("enable", BRIDGE)

    def waits_for(state, seconds, why):
        wait_until(seconds, lambda: system.show(BRIDGE, "ActiveState") == state, f"{state}: {why}")

    system.ctl("start", "--no-block", BRIDGE)
    time.sleep(2)
    waits_for("inactive", 1, "there is no can0")
    for plugged in (1, 2):
        create_vcan("can0")
        since = time.time()
        waits_for("active", 20, f"can0 was plugged in, {plugged}")
        heard = wait_until(5, lambda since=since: test.network.last("CAN/STATE", since), "the bridge's state")
        check(heard.state_name != "armed" and heard.bus == "up", heard)
        came = time.time() - since
        since = time.time()
        ip("del can0")
        waits_for("inactive", 30, f"can0 was pulled out, {plugged}")
        check(system.show(BRIDGE, "Result") == "success", system.show(BRIDGE, "Result"))
        test.say(f"can0 came: up after {came:.1f} s; it went: ended after {time.time() - since:.1f} s")


def outer_pid(d):
    """Process id of the bridge in this namespace."""
    found = subprocess.run(["pgrep", "--exact", "tether-can-brid"], capture_output=True, text=True, check=True).stdout
    return int(found.split()[0])


def units_are_hardened(test):
    """By systemd's own measure, from 0 to 10; and without words that it does not know."""
    for unit in sorted(UNITS.glob("*.service")):
        known = subprocess.run(["systemd-analyze", "verify", "--man=no", unit], capture_output=True, text=True, check=False)
        complaints = [line for line in known.stderr.splitlines() if unit.name in line and "not executable" not in line]
        check(not complaints, "\n".join(complaints))
    exposed = {}
    with tempfile.TemporaryDirectory() as root:
        folder = pathlib.Path(root) / "etc/systemd/system"
        shutil.copytree(UNITS, folder, ignore=lambda _, names: [name for name in names if not name.endswith(".service")])
        (folder / HARDENING).parent.mkdir()
        shutil.copy(UNITS / "hardening.conf", folder / HARDENING)

        def exposure_of(unit):
            said = subprocess.run(["systemd-analyze", "security", "--offline=true", f"--root={root}", unit],
                                  capture_output=True, text=True, check=False).stdout
            return float(re.search(r"exposure level for \S+: ([\d.]+)", said)[1])

        for unit in sorted(UNITS.glob("*.service")):
            exposed[unit.stem] = exposure_of(unit.name)
    test.say(f"exposure: {exposed}")
    for name, exposure in exposed.items():
        check(exposure <= MOST_EXPOSED.get(name, 1.5), f"{name}: {exposure}")


main(units_are_hardened, the_bridge_follows_its_adapter, bridge_as_a_service, a_serial_adapter_stalls)
