#!/usr/bin/env -S python3 -B
"""The lines for chrony in docs/howto/deployment.md, run by chrony in two network namespaces: the vehicle takes its time
from the control host, though neither knows any other clock. No clock is set (chronyd -x). Where chrony is not installed,
its Debian package is unpacked into BUILD/chrony, because an installed one would take over this machine's clock.
Usage: clocks_test.py BUILD"""

import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time

SOURCE = pathlib.Path(__file__).resolve().parents[2]
PAGE = (SOURCE / "docs/howto/deployment.md").read_text()
ADDRESSES = {"control": "192.0.2.2", "vehicle": "192.0.2.7"}  # the page's network plan


def check(condition, what):
    if not condition:
        sys.exit(f"FAILED: {what}")


def run(*command, **options):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False, **options)
    check(done.returncode == 0, f"{' '.join(map(str, command))}: {done.stdout}{done.stderr}")
    return done.stdout


def programs(build):
    """chronyd and chronyc."""
    path = os.pathsep.join((os.environ["PATH"], "/usr/sbin"))
    if all(shutil.which(name, path=path) for name in ("chronyd", "chronyc")):
        return [shutil.which(name, path=path) for name in ("chronyd", "chronyc")]
    unpacked = build / "chrony"
    return [unpacked / "usr/sbin/chronyd", unpacked / "usr/bin/chronyc"]


def fetch(build):
    """By apt, once."""
    if all(pathlib.Path(program).exists() for program in programs(build)):
        return
    folder = build / "chrony"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    run("apt-get", "download", "chrony", cwd=folder)
    for package in folder.glob("chrony_*.deb"):
        run("dpkg-deb", "--extract", package, folder)


def lines_of_the_page():
    """Host -> its lines, which stand side by side."""
    found = re.search(r"(?m)^    control: +(.*?) {3,}vehicle: +(.*)\n +(.*?) {3,}(.*)$", PAGE)
    check(found, "deployment.md has no lines for chrony")
    check(found[1].startswith("allow") and found[2].startswith("server"), found[0])
    return {"control": [found[1], found[3]], "vehicle": [found[2], found[4]]}


def namespaces():
    """Host -> the process that keeps its network; a cable between both."""
    own = os.readlink("/proc/self/ns/net")
    hosts = {name: subprocess.Popen(["unshare", "--net", "sleep", "1000"]) for name in ADDRESSES}
    end = time.monotonic() + 5
    while any(os.readlink(f"/proc/{host.pid}/ns/net") == own for host in hosts.values()):
        check(time.monotonic() < end, "no network namespaces")
        time.sleep(0.01)
    control, vehicle = (host.pid for host in hosts.values())
    run("ip", "link", "add", "wlan0", "netns", control, "type", "veth", "peer", "name", "wlan0", "netns", vehicle)
    for name, host in hosts.items():
        enter = ("nsenter", f"--net=/proc/{host.pid}/ns/net", "ip")
        run(*enter, "address", "add", f"{ADDRESSES[name]}/24", "dev", "wlan0")
        run(*enter, "link", "set", "wlan0", "up")
    return hosts


def the_vehicle_follows_the_control_host(build, work):
    chronyd, chronyc = programs(build)
    hosts = namespaces()
    daemons = []
    try:
        for name, lines in lines_of_the_page().items():
            folder = work / name
            folder.mkdir(mode=0o750)
            ours = [f"pidfile {folder}/pid", f"bindcmdaddress {folder}/socket", "cmdport 0"]
            (folder / "chrony.conf").write_text("\n".join([*lines, *ours]) + "\n")
            said = (folder / "said").open("w")
            daemons.append(subprocess.Popen(["nsenter", f"--net=/proc/{hosts[name].pid}/ns/net", chronyd, "-x", "-d", "-u", "root",
                                             "-f", folder / "chrony.conf"], stdout=said, stderr=said))
        begin, tracking = time.monotonic(), ""
        while f"({ADDRESSES['control']})" not in tracking:
            said = "".join((work / name / "said").read_text() for name in hosts)
            check(time.monotonic() < begin + 30 and all(daemon.poll() is None for daemon in daemons), f"{tracking}{said}")
            time.sleep(0.5)
            tracking = subprocess.run([chronyc, "-n", "-h", work / "vehicle/socket", "tracking"], capture_output=True, text=True,
                                      check=False).stdout
        stratum = re.search(r"Stratum +: (\d+)", tracking)[1]
        offset = float(re.search(r"Last offset +: ([+-][\d.]+) seconds", tracking)[1])
        check(stratum == "11", tracking)  # one below the page's
        check(abs(offset) < 0.02, tracking)
        print(f"the vehicle follows {ADDRESSES['control']} after {time.monotonic() - begin:.1f} s, {offset * 1e6:+.0f} us apart")
    finally:
        for process in (*daemons, *hosts.values()):
            process.kill()
            process.wait()


BUILD = pathlib.Path(sys.argv[1])
if sys.argv[2:] == ["fetch"]:
    fetch(BUILD)
else:
    with tempfile.TemporaryDirectory() as folder:
        the_vehicle_follows_the_control_host(BUILD, pathlib.Path(folder))
