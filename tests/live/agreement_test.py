#!/usr/bin/env -S python3 -B
"""Real time agrees with virtual time: `tether live` on the paper's scenario gives the error of
`tether run`, at the pace of the wall clock, and the same files; and scans are localised in it.
Usage: agreement_test.py BIN_DIR"""

import csv
import json
import pathlib
import re

from live_support import PAPER, SOURCE, check, main, median, wait_until

# Wall clock against simulated time. A busy machine delays single messages by any amount, so the
# medians count: of all messages for the offset, of the first and last thirds for the drift.
MAX_OFFSET_S = 0.005
MAX_DRIFT_S = 0.005
DURATION_S = 62.0


def start_of_run_s(live):
    """The wall-clock time of t = 0, as `tether live` told its nodes."""
    sim = wait_until(5, lambda: live.children().get("tether-sim"), "tether-sim starts")
    arguments = pathlib.Path(f"/proc/{sim}/cmdline").read_text().split("\0")
    return int(next(a for a in arguments if a.startswith("--start-utime=")).split("=")[1]) * 1e-6


def check_pace(test, channel, start_s):
    messages = [m for m in test.network.messages(channel) if 0 < m.utime < DURATION_S * 1e6 - 1]
    check(messages[-1].utime - messages[0].utime > 60e6, f"{channel}: less than 60 s heard")
    offsets = [m.arrival - start_s - m.utime * 1e-6 for m in messages]
    third = len(offsets) // 3
    offset = median(offsets)
    drift = median(offsets[-third:]) - median(offsets[:third])
    test.say(
        f"{channel}: {len(offsets)} messages, behind the wall clock by {offset * 1e3:.2f} ms "
        f"(median), at worst {max(offsets) * 1e3:.1f} ms, drift {drift * 1e3:+.2f} ms in 40 s"
    )
    check(abs(offset) < MAX_OFFSET_S, f"{channel}: simulated time is off by {offset:.4f} s")
    check(abs(drift) < MAX_DRIFT_S, f"{channel}: simulated time drifts by {drift:.4f} s in 40 s")


def check_slips(test, live, counters):
    """A node's report on its slips at its end agrees with the summary."""
    for node in ("sim", "netem", "controller"):
        counted = counters[f"{node}.loop.slips"]
        said = re.search(rf"^tether-{node}: (\d+) deadline slips, worst", live.err(), re.MULTILINE)
        number = int(said.group(1)) if said else 0
        check(number == counted, f"{node} says {number} slips, the summary {counted}")
        if counted:
            test.say(live.err()[said.start() :].splitlines()[0])
    test.say("slips: " + ", ".join(f"{k} {v}" for k, v in counters.items() if "slips" in k))


def check_files(test, out, summary):
    # By the file's column names; the truth as the network carried it.
    rows = list(csv.DictReader((out / "trajectory.csv").open()))
    truth = {m.utime: m for m in test.network.messages("SIM/TRUTH")}
    check(len(rows) > 0.95 * DURATION_S * 50, f"trajectory.csv has {len(rows)} rows")
    heard = [r for r in rows if round(float(r["t_s"]) * 1e6) in truth]
    check(len(heard) > 0.95 * len(rows), f"{len(heard)} of {len(rows)} rows were on SIM/TRUTH")
    for row in heard:
        m = truth[round(float(row["t_s"]) * 1e6)]
        check(float(row["x_m"]) == m.x_m and float(row["error_m"]) == m.error_m, f"row {row}")
    mean = sum(float(r["error_m"]) for r in rows) / len(rows)
    check(abs(mean - summary["epsilon_m"]) < 0.02, f"mean error in trajectory.csv is {mean}")

    check(json.loads((out / "summary.json").read_text()) == summary, "summary.json differs")
    check("<svg" in (out / "path.svg").read_text(), "path.svg is no picture")
    check((out / "path.png").read_bytes().startswith(b"\x89PNG"), "path.png is no picture")

    info = test.run("tether", "log", "info", out / "run.lcmlog")
    check(info.process.returncode == 0, "tether log info fails")
    for line in (r"^AGV/POSE +pose_t +63\b", r"^SIM/TRUTH +ground_truth_t +3\d\d\d\b"):
        check(re.search(line, info.out(), re.MULTILINE), f"no {line} in:\n{info.out()}")
    check("DAMAGED" not in info.out() and "TRUNCATED" not in info.out(), info.out())

    # The resolved scenario is the run's.
    again = test.run("tether", "run", out / "scenario.toml", "--json", seconds=60)
    return json.loads(again.out()), len(rows)


def live_agrees_with_virtual_time(test):
    out = test.work / "out"
    live = test.start("tether", "live", PAPER, "--json", "--out", out)
    start_s = start_of_run_s(live)
    check(live.wait(90) == 0, "tether live fails")
    summary = json.loads(live.out())

    virtual = json.loads(test.run("tether", "run", PAPER, "--json", seconds=60).out())
    difference = summary["epsilon_m"] / virtual["epsilon_m"] - 1.0
    test.say(
        f"epsilon live {summary['epsilon_m']:.4f} m, virtual {virtual['epsilon_m']:.4f} m: "
        f"{difference:+.2%}; age {summary['aoi_ms_mean']:.1f} and {virtual['aoi_ms_mean']:.1f} ms; "
        f"delays {summary['uplink']['delay_ms_mean']:.3f} ms up"
    )
    check(abs(difference) < 0.10, "live and virtual errors differ by 10 % or more")
    check(summary["uplink"]["sent"] == virtual["uplink"]["sent"] == 63, "not 63 poses")
    for link in ("uplink", "downlink"):
        check(summary[link]["delivered"] == summary[link]["sent"] >= 62, f"{link}: lost packets")
    check(abs(summary["sim_time_s"] - DURATION_S) < 0.01, f"simulated {summary['sim_time_s']} s")

    check_pace(test, "SIM/CLOCK", start_s)
    check_pace(test, "SIM/TRUTH", start_s)
    check_slips(test, live, summary["counters"])
    again, rows = check_files(test, out, summary)
    check(again["epsilon_m"] == virtual["epsilon_m"], "scenario.toml is not the run's scenario")
    test.say(f"files: {rows} rows of trajectory as on SIM/TRUTH, log, pictures, summary, scenario")


def live_localises_by_scans(test):
    out = test.work / "localised"
    factory = SOURCE / "scenarios" / "factory.toml"
    command = ("tether", "live", factory, "--set", "vehicle.plant=kinematic")
    live = test.run(*command, "--duration", "4", "--json", "--out", out, seconds=30)
    check(live.process.returncode == 0, f"tether live fails: {live.err()}")
    check(json.loads(live.out())["valid"], "the run is not valid")
    info = test.run("tether", "log", "info", out / "run.lcmlog").out()
    # 15 a second for 4 s, less what a busy machine costs.
    for line in (r"^AGV/SCAN +scan_t +[56]\d\b", r"^AGV/LOCALISATION +localisation_t +[3-6]\d\b"):
        check(re.search(line, info, re.MULTILINE), f"no {line} in:\n{info}")
    table = test.run("tether", "log", "csv", out / "run.lcmlog", "AGV/LOCALISATION").out()
    states = {row["state"] for row in csv.DictReader(table.splitlines())}
    check("1" in states, f"does not track: states {states}")
    test.say(f"localised by scans: valid, states {sorted(states)}")


main(live_agrees_with_virtual_time, live_localises_by_scans)
