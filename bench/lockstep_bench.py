#!/usr/bin/env -S python3 -B
"""Cost of a run in lockstep: its wall time against its floor, one round trip over LCM for each
grant, as measured in the same run between other grants. Usage: lockstep_bench.py BIN_DIR

one_process_s: the same run without processes, that is, the nodes' own work; over_work_and_floor:
wall time over both together; without_physics: with the kinematic plant, which costs next to
nothing. Medians."""

import json
import os
import pathlib
import statistics
import subprocess
import sys

PAPER = pathlib.Path(__file__).resolve().parent.parent / "scenarios" / "paper.toml"
OFTEN = ("sensor.rate_hz=20", "channel.delay_ms=30")
CASES = {
    "paper_1_Hz": (),
    "pose_and_command_20_Hz": OFTEN,
    "without_physics_20_Hz": (*OFTEN, "vehicle.plant=kinematic"),
}


def run(tether, settings, *options):
    sets = [word for setting in settings for word in ("--set", setting)]
    command = [tether, "run", PAPER, "--json", *sets, *options]
    return json.loads(subprocess.run(command, check=True, capture_output=True).stdout)


def main():
    tether = pathlib.Path(sys.argv[1]).resolve() / "tether"
    rounds = 1 if os.environ.get("TETHER_BENCH_SMOKE") else 7
    for name, settings in CASES.items():
        pairs = []
        for _ in range(rounds):
            pairs.append((run(tether, settings, "--processes"), run(tether, settings)))
        lockstep = [together["lockstep"] for together, _ in pairs]

        def median(values):
            return statistics.median(values)

        def over_both(together, alone):
            cost = together["lockstep"]
            trips_s = cost["grants"] * cost["round_trip_us_median"] * 1e-6
            return cost["wall_time_s"] / (trips_s + alone["wall_time_s"])

        print(
            f"{name:<24}"
            f" grants={lockstep[0]['grants']}"
            f"  round_trip_us={median(r['round_trip_us_median'] for r in lockstep):.0f}"
            f"  over_floor={median(r['over_floor'] for r in lockstep):.2f}"
            f"  over_work_and_floor={median(over_both(*pair) for pair in pairs):.2f}"
            f"  wall_s={median(r['wall_time_s'] for r in lockstep):.2f}"
            f"  one_process_s={median(alone['wall_time_s'] for _, alone in pairs):.2f}"
            f"  real_time_factor={median(r['real_time_factor'] for r, _ in pairs):.0f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
