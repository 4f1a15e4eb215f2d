#!/usr/bin/env -S python3 -B
"""Exports of `tether log mcap` and `tether log csv` from a run's log, read by other programs: @mcap/core validates
every checksum, ajv the JSON by our and by Foxglove's schemas, @foxglove/rosmsg2-serialization decodes
the ROS 2 bag. And what they say of bad input.

Usage: mcap_test.py BIN_DIR NPM_DIR; packages of package-lock.json are installed to NPM_DIR once.
"""

import pathlib
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "support"))
from npm_packages import fail, install  # noqa: E402

PAPER = HERE.parents[1] / "scenarios" / "paper.toml"
TETHER = pathlib.Path(sys.argv[1]).resolve() / "tether"
NPM = pathlib.Path(sys.argv[2]).resolve()


def run(*command, code=0, says="", cwd=None):
    done = subprocess.run([str(c) for c in command], cwd=cwd, capture_output=True, text=True)
    said = done.stdout + done.stderr
    if done.returncode != code or says not in said:
        fail(f"{' '.join(map(str, command))}: exit code {done.returncode}, not {code} with \"{says}\": {said}")
    return said


def by_others(work, run_dir, name):
    """The log of a run as JSON and as a bag, against its tables."""
    log, out = run_dir / "run.lcmlog", work / name
    run(TETHER, "log", "csv", log, "--out", out)
    for script, options in (("check_json.mjs", []), ("check_ros2.mjs", ["--ros2"])):
        file = work / f"{name}.mcap"
        run(TETHER, "log", "mcap", log, "--out", file, *options)
        print(f"{name}, {script}:", run("node", NPM / script, file, out).strip())
        first = file.read_bytes()
        run(TETHER, "log", "mcap", log, "--out", file, *options)
        if file.read_bytes() != first:
            fail(f"{file.name} came out otherwise the second time")


def bad_input(work, log):
    cut, foreign, empty = work / "cut.lcmlog", work / "foreign.lcmlog", work / "empty.lcmlog"
    cut.write_bytes(log.read_bytes()[:100_000])
    run(TETHER, "log", "mcap", cut, says="TRUNCATED: ends in the middle of the record")
    run(TETHER, "log", "csv", cut, "--out", work / "cut", says="TRUNCATED")
    scenario = log.with_name("scenario.toml")
    run("node", NPM / "check_json.mjs", work / "cut.mcap", work / "cut")
    empty.touch()
    run(TETHER, "log", "mcap", empty, code=2, says="is empty: it has no messages")
    run(TETHER, "log", "mcap", scenario, code=2, says="is not an LCM event log")
    run(TETHER, "log", "mcap", work / "nowhere", code=2, says="cannot read the log")
    foreign.write_bytes(bytes.fromhex("eda1da01") + bytes(16) + bytes([0, 0, 0, 1, 0, 0, 0, 9]) + b"Xsome data")
    run(TETHER, "log", "mcap", foreign, code=2, says="none of the 1 messages is of a type that Tether knows")
    mixed = work / "mixed.lcmlog"
    mixed.write_bytes(log.read_bytes() + foreign.read_bytes())
    run(TETHER, "log", "mcap", mixed, says="left out 1 message on X: of an unknown type (0x736f6d6520646174)")
    run(TETHER, "log", "mcap", log, "--out", log, code=2, says="is the log itself")
    run(TETHER, "log", "mcap", log, "--out", work, code=2, says="is a directory")
    run(TETHER, "log", "mcap", log, "--out", work / "no" / "x", code=1, says="No such file or directory")
    run(TETHER, "log", "mcap", log, "--out", "/dev/full", code=1, says="No space left on device")
    run(TETHER, "log", "mcap", log, "--scenario", work / "nowhere", code=2, says="nowhere")
    run(TETHER, "log", "csv", log, code=2, says="needs --out FOLDER")
    run(TETHER, "log", "csv", log, "--out", work / "cut", code=2, says="is not empty")
    run(TETHER, "log", "csv", log, "--out", cut, code=2, says="is not a folder")


def a_scenario_that_cannot_be_read_costs_only_the_shapes(work, log):
    alone = work / "alone"
    alone.mkdir()
    shutil.copy(log, alone)
    (alone / "scenario.toml").write_text("[nonsense]\nx = 1\n")
    run(TETHER, "log", "mcap", alone / "run.lcmlog", says="no path and no shapes: ")


def times_below_zero_move_up_by_whole_seconds(work, common):
    run(TETHER, "run", PAPER, *common, "--set", "run.duration_s=5", "--set", "run.lead_s=1.5", "--out",
        work / "lead")
    run(TETHER, "log", "mcap", work / "lead" / "run.lcmlog", says="times are 2 s later than in the log")


HALL = """
[lidar]
model = "custom"
rate_hz = 5.0
beams = 91
[[world.obstacle]]
kind = "rack"
x_m = 15.0
y_m = 15.0
[[world.obstacle]]
kind = "cylinder"
x_m = -15.0
y_m = -10.0
to = [[-15.0, 10.0]]
"""

install(HERE, NPM)
with tempfile.TemporaryDirectory() as folder:
    work = pathlib.Path(folder)
    common = ["--set", "vehicle.plant=kinematic", "--set", "sensor.rate_hz=20", "--set",
              "sensor.odometry_rate_hz=10", "--set", "channel.prr=0.8"]
    hall = work / "hall.toml"
    hall.write_text(PAPER.read_text() + HALL)
    run(TETHER, "run", hall, *common, "--set", "run.duration_s=20", "--out", work / "run")
    by_others(work, work / "run", "paper")
    bad_input(work, work / "run" / "run.lcmlog")
    a_scenario_that_cannot_be_read_costs_only_the_shapes(work, work / "run" / "run.lcmlog")
    times_below_zero_move_up_by_whole_seconds(work, common)
print("passed")
