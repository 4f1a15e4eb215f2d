#!/usr/bin/env -S python3 -B
"""Injects faults by campaigns, each with its seeds, and sums up how many there were and how many led to a wrong result:
forged, spliced, reflected, replayed and changed datagrams of a link, and its restarts; an external controller that lies in
lockstep; nodes that are killed; datagrams of lockstep that are lost, doubled and late. More than 10^6 in all; with
`--long` ten times as many.
Usage: faults.py BUILD_DIR [--long]"""

import os
import pathlib
import re
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
NETWORK = HERE.parent / "support" / "in_own_network.sh"


def campaigns(build, long):
    """name: (command, environment, faults, or the pattern of their number in the output)"""
    forgeries = 10_000_000 if long else 1_000_000
    lies, kills, lossy_runs = (10, 300, 480) if long else (1, 25, 48)
    link = build / "tests" / "link_forgery_test"
    return {
        "datagrams of a link": ((link,), {"TETHER_FORGERIES": str(forgeries)}, forgeries),
        "lies in lockstep": ((NETWORK, HERE / "lying_controller_test.py", build / "bin", lies), {}, r"^(\d+) lies of"),
        "kills in lockstep": ((NETWORK, HERE / "kill_campaign_test.py", build / "bin", kills), {}, r"^(\d+) kills:"),
        "datagrams of lockstep": (
            (NETWORK, HERE / "lossy_lockstep_test.py", build / "bin", lossy_runs), {}, r"^(\d+) faults in"),
    }


def main():
    build = pathlib.Path(sys.argv[1]).resolve()
    total, failed = 0, []
    for name, (command, environment, count) in campaigns(build, "--long" in sys.argv[2:]).items():
        done = subprocess.run([str(word) for word in command], env=os.environ | environment, capture_output=True, text=True)
        if isinstance(count, str):
            found = re.search(count, done.stdout, re.MULTILINE)
            count = int(found[1]) if found else 0
        if done.returncode != 0 or count == 0:
            failed.append(name)
            print(done.stdout[-3000:], done.stderr[-3000:], file=sys.stderr)
        total += count
        right = f"0 wrong results: at most {3 / max(count, 1):.1e} of them lead to one, with 95 % confidence"
        print(f"{name}: {count} faults, " + ("FAILED" if name in failed else right), flush=True)
    if failed:
        sys.exit(f"faults.py: {', '.join(failed)} failed")
    print(f"{total} faults in all, drawn as here")


main()
