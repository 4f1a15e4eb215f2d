#!/usr/bin/env -S python3 -B
"""The report of two sweeps, served by `tether view`, in Chromium: report_view_test.mjs.

Usage: report_view_test.py BIN_DIR NPM_DIR
"""

import json
import pathlib
import sqlite3
import subprocess
import sys
import tempfile

from page_support import SOURCE, fail, install

BIN, NPM = (pathlib.Path(argument).resolve() for argument in sys.argv[1:3])
EXPERIMENT = """
scenario = "{source}/scenarios/paper.toml"
seeds = 3
[set]
vehicle.plant = "kinematic"
run.duration_s = 20.0
{more}
[grid]
channel.prr = [0.5, 1.0]
[figure]
kind = "curve"
x = "channel.prr"
"""
WAYPOINTS = "x_m,y_m\n0,0\n5,0\n10,3\n15,3\n"


def sweep(work, folder, name, more=""):
    experiment = work / f"{name}.toml"
    experiment.write_text(EXPERIMENT.format(source=SOURCE, more=more))
    run("sweep", experiment, "--out", folder)


def run(*arguments):
    done = subprocess.run([BIN / "tether", *arguments], capture_output=True, text=True)
    if done.returncode != 0:
        fail(f"tether {arguments}: {done.stderr}")


def runs_of(folder):
    """[arm, seed, ε] of each."""
    with sqlite3.connect(folder / "runs.sqlite") as database:
        return list(database.execute("SELECT arm, seed, epsilon_m FROM runs"))


def main():
    install(NPM)
    with tempfile.TemporaryDirectory() as work:
        work = pathlib.Path(work)
        sweep(work, work / "out" / "two words", "prr")
        waypoints = work / "waypoints.csv"
        waypoints.write_text(WAYPOINTS)
        sweep(work, work / "out" / "waypoints", "waypoints", f'path.kind = "csv"\npath.csv = "{waypoints}"')
        run("report", work / "out")
        waypoints.unlink()  # the second sweep's runs cannot be made again
        (work / "runs.json").write_text(json.dumps(runs_of(work / "out" / "two words")))
        sys.exit(subprocess.run(["node", NPM / "report_view_test.mjs", BIN / "tether", work]).returncode)


main()
