#!/usr/bin/env -S python3 -B
"""The page of `tether view` in Chromium, against the server itself: browser_test.mjs, states_test.mjs.

Usage: page_test.py BIN_DIR NPM_DIR; packages of package-lock.json are installed to NPM_DIR once.
"""

import pathlib
import subprocess
import sys
import tempfile

from page_support import SOURCE, fail, install, write_fleet_log, write_hostile_log

HALL = """
[lidar]
model = "custom"
rate_hz = 5.0
range_max_m = 100.0
range_10_m = 100.0
fov_rad = 6.28
[[world.obstacle]]
kind = "box"
x_m = 20.0
y_m = 10.0
[[world.obstacle]]
kind = "box"
x_m = 17.0
y_m = 17.0
pause_s = 1000.0
to = [[-17.0, 17.0]]
"""
LCM_URL = "udpm://239.255.76.67:7667?ttl=0"
# Each would leave a mark on the page if it were more than text.
HOSTILE = (
    "<!--<script>", "</script><script>globalThis.taken = 1</script>", "<img src=x onerror='globalThis.taken = 1'>",
    "]]>\"'&<b class=taken>", "</title><h1 class=taken>",
)
BIN, NPM = (pathlib.Path(argument).resolve() for argument in sys.argv[1:3])


def main():
    install(NPM)
    with tempfile.TemporaryDirectory() as work:
        work = pathlib.Path(work)
        scenario = SOURCE / "scenarios" / "paper.toml"
        run = [BIN / "tether", "run", scenario, "--set", "vehicle.plant=kinematic", "--set", "sensor.rate_hz=20",
               "--set", "channel.uplink.delay_ms=100", "--set", "run.duration_s=40", "--out", work / "run"]
        done = subprocess.run(run, capture_output=True, text=True)
        if done.returncode != 0:
            fail(f"tether run: {done.stderr}")
        write_fleet_log(work / "fleet.lcmlog", vehicles=100, rate_hz=50, seconds=30)
        hall = work / "hall.toml"
        hall.write_text(scenario.read_text() + HALL)
        hostile = work / "hostile.lcmlog"
        write_hostile_log(hostile, HOSTILE)
        node = ["node", NPM / "states_test.mjs", BIN / "tether", scenario, LCM_URL, work / "run" / "run.lcmlog", hall, hostile]
        states = subprocess.run([SOURCE / "tests" / "support" / "in_own_network.sh", *node]).returncode
        every = subprocess.run(["node", NPM / "browser_test.mjs", BIN / "tether", scenario, work]).returncode
        sys.exit(states or every)


main()
