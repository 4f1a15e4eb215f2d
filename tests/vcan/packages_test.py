#!/usr/bin/env -S python3 -B
"""The vehicle's package on a booted system: installed, its link enabled, stopped and hung, then updated and
taken back to the version before, with settings and keys as they were. Usage: packages_test.py BIN_DIR"""

import re
import subprocess
import time
import urllib.request

from booted import Booted
from live_support import SOURCE, check, main, wait_until

PAGE = (SOURCE / "docs/howto/deployment.md").read_text()
LINK = "tether-link.service"
HOST = "tether-host.service"
LOGGER = "tether-logger.service"
METRICS = "tether-metrics.service"
UNITS = [f"tether-{name}.service" for name in ("link", "can-bridge", "localiser", "autonomy", "logger", "metrics")]


class Vehicle(Booted):
    def __init__(self, test):
        super().__init__(test, test.bin, for_packages=True)

    def give_apt(self):
        """Folders that Debian's apt has, and the answer to its question."""
        for folder in ("etc/apt/apt.conf.d", "etc/apt/preferences.d", "var/lib/apt/lists/partial", "var/cache/apt/archives/partial",
                       "var/log/apt"):
            (self.root / folder).mkdir(parents=True, exist_ok=True)
        (self.root / "etc/apt/apt.conf.d/test").write_text('APT::Get::Assume-Yes "true";\nAPT::Sandbox::User "root";\n')

    def give_link(self):
        """Keys as the guide says; the peer is elsewhere."""
        other = self.run("tether-link", "keygen", "/root/other.key")
        self.run("tether-link", "keygen", "/etc/tether/link.key")
        self.run("chown", "tether:", "/etc/tether/link.key")
        file = self.root / "etc/tether/link.toml"
        file.write_text(f"""
            key = "link.key"
            [[path]]
            name = "wifi"
            bind = "127.0.0.1:7700"
            [[path]]
            name = "5g"
            bind = "0.0.0.0:7701"
            interface = "wwan0"
            [[peer]]
            name = "control"
            public_key = "{other}"
            addresses = ["127.0.0.1:7710", ""]
            """)
        file.chmod(0o644)

    @staticmethod
    def update_of_the_page(which):
        """Its commands, for the vehicle's package alone: "later", or back to "now"."""
        block = re.search(r"(?m)^    sudo cp -a /etc/tether .*\n    (sudo apt install .*)$", PAGE)
        back = re.search(r"`(sudo apt install --allow-downgrades \S+ \S+)`", PAGE)
        check(block and back, "deployment.md says how to update, and how to go back")
        copy, update = block[0].splitlines()
        if which == "now":
            update = back[1] + update[update.index(" && "):]
        for word in ("./tether_NEW.deb ", "./tether_OLD.deb "):
            update = update.replace(word, "")
        update = re.sub(r"\./tether-vehicle_(NEW|OLD)\.deb", f"/root/{which}.deb", update)
        return [command.partition("#")[0].strip().replace("sudo ", "") for command in (copy, update)]

    def logs(self):
        return sorted(file.name for file in (self.root / "var/lib/tether").glob("floor-*.lcmlog"))

    def link_said(self):
        return (self.root / "var/tether-link.said").read_text()

    def wait_link(self, seconds=10):
        wait_until(seconds, lambda: self.show(LINK, "ActiveState") == "active", "the link is up")


def installed_updated_and_taken_back(test):
    system = Vehicle(test)
    system.start(test)
    system.install("now")
    check("tether:" in (system.root / "etc/passwd").read_text(), "the package makes the user")
    states = system.ctl("is-enabled", *UNITS, check_it=False).split()
    check(states == ["disabled"] * len(UNITS), f"nothing starts by being installed: {states}")
    check(system.ctl("is-enabled", HOST) == "enabled", "what keeps LCM on this host is enabled")
    owner = (system.root / "var/lib/tether").stat()
    check(system.run("id", "--user", "tether") == str(owner.st_uid), "the state folder is there, and tether's")

    system.ctl("enable", LINK)
    failed = system.ctl("start", LINK, check_it=False)
    check(system.show(LINK, "ActiveState") != "active", f"up without its file: {failed}")
    wait_until(5, lambda: "link.toml" in system.link_said(), "a line about the file that is missing")
    system.give_link()
    system.wait_link()  # it never gives up
    check(system.ctl("is-enabled", LINK) == "enabled", "enabled")
    check(system.show(HOST, "ActiveState") == "active", "with settings, this host is made ready before the link")
    route = system.run("ip", "route", "show", "239.255.76.67")
    check("dev lo" in route and "src 127.0.0.1" in route, route)
    check(system.show(LINK, "StatusText").startswith("running on udpm"), system.show(LINK, "StatusText"))
    said = system.link_said()
    check('path "5g" is closed, and tried again each second: cannot use interface "wwan0"' in said, said)
    status = system.run("cat", f"/proc/{system.show(LINK, 'MainPID')}/status")
    kept = dict(line.split(":\t", 1) for line in status.splitlines() if ":\t" in line)
    check(int(kept["CapBnd"], 16) == 0 and kept["NoNewPrivs"] == "1" and kept["Uid"].split()[0] != "0", str(kept))
    test.say(f"installed; the link is up as user {kept['Uid'].split()[0]} without any capability")

    for name in ("STOP", "KILL"):
        before = int(system.show(LINK, "NRestarts"))
        system.run("kill", f"-{name}", system.show(LINK, "MainPID"))
        wait_until(12, lambda before=before: int(system.show(LINK, "NRestarts")) > before, f"restarted after SIG{name}")
        system.wait_link()
    test.say("restarted after SIGSTOP (watchdog) and SIGKILL")

    on_board = [f"tether-{name}.service" for name in ("localiser", "autonomy")]
    system.configure(TETHER_SCENARIO="/usr/share/tether/scenarios/factory.toml",
                     TETHER_RECORD='"--keep-free-mb 10 --file-mb 0.001 --files 3"')
    system.ctl("start", *on_board, LOGGER, METRICS)
    time.sleep(2)
    number = system.run("cat", "/run/tether/host.env").removeprefix("TETHER_START_UTIME=")
    check(abs(int(number) * 1e-6 - time.time()) < 60, f"the run's number is of this start: {number}")
    commands = system.run("cat", f"/proc/{system.show(on_board[0], 'MainPID')}/cmdline").split("\0")
    check(number in commands, commands)
    wait_until(15, lambda: system.logs()[0] > "floor-00000001.lcmlog", "the oldest log is deleted")
    check(len(system.logs()) == 3, f"the newest three are kept: {system.logs()}")
    with urllib.request.urlopen("http://127.0.0.1:9765/metrics", timeout=5) as answer:
        served = answer.read().decode()
    check('tether_node_events_total{vehicle="AGV",node="localiser",' in served, served)
    check(system.show(METRICS, "StatusText") == "serving http://127.0.0.1:9765/metrics", system.show(METRICS, "StatusText"))
    for unit in (*on_board, LOGGER, METRICS):
        state = (system.show(unit, "ActiveState"), system.show(unit, "NRestarts"), system.show(unit, "StatusText").split()[0])
        check(state == ("active", "0", "running" if unit in on_board else state[2]), f"{unit}: {state}\n{system.said()}")
    system.ctl("stop", *on_board, LOGGER, METRICS)
    test.say("localiser, on-board driver, logger and metrics run")

    system.ctl("disable", HOST)

    key = system.run("tether-link", "show", "/etc/tether/link.key")
    system.give_apt()
    for which in ("later", "now"):
        system.run("sh", "-c", " && ".join(system.update_of_the_page(which)))
        status = system.run("dpkg-query", "--show", "--showformat=${db:Status-Status} ${Version}", "tether-vehicle")
        check(status == f"installed {system.packages[which][1]}", status)
        system.wait_link()
        check(system.run("sh", "-c", "stat --format %U /root/tether-*/link.key") == "tether", "the copy has its owners")
        system.run("sh", "-c", "rm -r /etc/tether && mv /root/tether-* /etc/tether")  # the copy goes back
        system.ctl("restart", LINK)
        system.wait_link()
        check(system.ctl("is-enabled", LINK) == "enabled", f"enabled, with {which}")
        check(system.ctl("is-enabled", HOST, check_it=False) == "disabled", "an update enables nothing again")
        check(system.run("tether-link", "show", "/etc/tether/link.key") == key, "the key is kept")
        test.say(f"{system.packages[which][1]}: the link is up with the same key")

    system.ctl("stop", LINK)
    check(system.show(LINK, "Result") == "success", system.show(LINK, "Result"))
    system.ctl("start", LINK)
    system.run("dpkg", "--purge", "tether-vehicle")
    check(system.show(LINK, "ActiveState") == "inactive", "a removed link does not go on")
    check(not list((system.root / "etc/systemd/system").glob("*/tether-link.service")), "nor is it enabled")
    check(system.run("ip", "route", "show", "239.255.76.67") == "", "nor does its route stay")
    check((system.root / "etc/tether/link.key").exists(), "keys belong to the user")
    check(not (system.root / "usr/bin/tether-link").exists(), "removed")


def a_machine_without_systemd(test):
    """The package makes the user and its folder all the same, and its programs run as that user."""
    system = Vehicle(test)
    for program in ("systemctl", "systemd-sysusers"):
        (system.root / "usr/bin" / program).unlink()

    def run(*command, code=0):
        done = subprocess.run(["chroot", system.root, *command], capture_output=True, text=True, check=False)
        check(done.returncode == code, f"{command}: {done.stdout}{done.stderr}")
        return done.stdout

    for which, options in (("now", ()), ("later", ())):
        run("env", "DEBIAN_FRONTEND=noninteractive", "dpkg", *options, "--install", system.packages[which][0])
    user = run("id", "tether")
    check("tether" in user and (system.root / "var/lib/tether").stat().st_uid != 0, user)
    (system.root / "run/logs").mkdir()
    run("chown", "tether:", "/run/logs")
    run("tether-vehicle", "lcm-route")
    as_tether = ["chroot", system.root, "setpriv", "--reuid=tether", "--regid=tether", "--clear-groups"]
    recorder = test.start("/usr/bin/env", *as_tether, "tether-vehicle", "record", "/run/logs", "--keep-free-mb", 1)
    bridge = test.start("/usr/bin/env", *as_tether, "tether-can-bridge", "/usr/share/tether/scenarios/hil_vcan.toml",
                        "--start-utime", int(time.time() * 1e6))

    def recorded():
        return b"CAN/STATE" in b"".join(file.read_bytes() for file in (system.root / "run/logs").iterdir())

    wait_until(15, recorded, "the bridge's state is recorded")
    for program in (bridge, recorder):
        program.kill(15)
        check(program.wait(20) == 0, program.err())
    run("dpkg", "--purge", "tether-vehicle")
    check(not (system.root / "usr/bin/tether-link").exists(), "removed")
    test.say(f"without systemd: {user.strip()}")


main(installed_updated_and_taken_back, a_machine_without_systemd)
