#!/usr/bin/env -S python3 -B
"""Injects faults by campaigns and sums up how many there were, and how many led to a wrong result with exit code 0: forged,
spliced, reflected, replayed and changed datagrams of a link, and its restarts; an external controller that lies in lockstep;
nodes that are killed; datagrams of lockstep that are lost, doubled and late. A round has more than 10^6, takes 6
to 13 minutes, and its number is the seed: `--from` continues after the last round that was reported.
Usage: faults.py BUILD_DIR [--rounds N | --minutes M] [--from ROUND]"""

import argparse
import os
import pathlib
import re
import subprocess
import sys
import time

HERE = pathlib.Path(__file__).resolve().parent
NETWORK = HERE.parent / "support" / "in_own_network.sh"
FORGERIES, KILLS, LOSSY_RUNS = 1_000_000, 25, 48


def campaigns(build, number):
    """name: (command, environment, faults, or the pattern of their number in the output)"""
    link = build / "tests" / "link_forgery_test"

    def script(name, *arguments):
        return NETWORK, HERE / f"{name}.py", build / "bin", *arguments

    return {
        "datagrams of a link": (
            (link,), {"TETHER_FORGERIES": str(FORGERIES), "TETHER_FORGERY_SEED": str(number)}, FORGERIES),
        "lies in lockstep": (script("lying_controller_test", 1, number), {}, r"^(\d+) lies of"),
        "kills in lockstep": (script("kill_campaign_test", KILLS, number), {}, r"^(\d+) kills:"),
        "datagrams of lockstep": (
            script("lossy_lockstep_test", LOSSY_RUNS, LOSSY_RUNS * (number - 1)), {}, r"^(\d+) faults in"),
    }


def faults_of(command, environment, count):
    """The faults that one campaign injected, 0 if it failed; and its output."""
    done = subprocess.run([str(word) for word in command], env=os.environ | environment, capture_output=True, text=True)
    if done.returncode != 0:
        return 0, done.stdout[-3000:] + done.stderr[-3000:]
    if isinstance(count, int):
        return count, done.stdout
    found = re.search(count, done.stdout, re.MULTILINE)
    return int(found[1]) if found else 0, done.stdout


def rounds(options):
    """Numbers of rounds, until as many or as much time as asked for have passed."""
    end = time.monotonic() + 60 * (options.minutes or 0)
    number = options.first
    while time.monotonic() < end if options.minutes else number < options.first + options.rounds:
        yield number
        number += 1


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build", type=lambda path: pathlib.Path(path).resolve())
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--minutes", type=float, help="begin rounds for this long")
    parser.add_argument("--from", type=int, default=1, dest="first", metavar="ROUND")
    options = parser.parse_args()
    sums, failed = {}, {}
    for number in rounds(options):
        for name, campaign in campaigns(options.build, number).items():
            began = time.monotonic()
            faults, output = faults_of(*campaign)
            sums[name] = sums.get(name, 0) + faults
            if faults == 0:
                failed.setdefault(name, []).append(number)
                print(output, file=sys.stderr)
            print(f"round {number}, {name}: {faults or 'FAILED, not counted'} faults, {time.monotonic() - began:.0f} s",
                  flush=True)
    for name, faults in sums.items():
        print(f"{name}: {faults} faults" + (f", and failures in rounds {failed[name]}" if name in failed else
              f", 0 wrong results: at most {3 / faults:.1e} of them lead to one, with 95 % confidence"))
    print(f"{sum(sums.values())} faults in all, drawn as here")
    if failed:
        sys.exit(f"faults.py: {', '.join(failed)} failed")


main()
