#!/usr/bin/env -S python3 -B
"""Every numeric option of every command has its bounds in its help and refuses what is outside of them, what is not a number,
and a second value, with exit code 2 and one line that names it.

Every number of every file that is read is tried with 0, -1, huge, tiny and undefined values, and every line
that names a key with a second one: refused with exit code 2 and one line that names the file, or right, which is an
exit code that the command may have and no inf or nan in what it says. Every key for a number that the readers
of such files know is in one of them. (Records of commissioning: tests/can_bridge/commission/guard_test.cpp.)
Usage: numbers_test.py BIN_DIR"""

import re
import shutil
import subprocess

from live_support import PAPER, SOURCE, check, main

VALUES = ("0", "-1", "1e308", "-1e308", "1e-308", "nan", "inf", "9223372036854775807", "1e400", "")
SECONDS = 60
NUMBER = re.compile(r"(?<![\w.\"'-])0x[0-9A-Fa-f]+|(?<![\w.\"'-])-?\d+\.?\d*(?:e-?\d+)?(?![\w.\"'])")
LINK = """key = "own.key"
mtu = 1400
second_path = "deferred"
second_after_ms = 20.0
rekey_s = 3600.0
report_period_s = 1.0
clock_warning_ms = 50.0
clock_limit_ms = 200.0
[[path]]
name = "wifi"
bind = "127.0.0.1:7700"
[[path]]
name = "cell"
bind = "127.0.0.1:7701"
[[peer]]
name = "vehicle"
public_key = "KEY"
addresses = ["127.0.0.1:7702", ""]
"""
SHORT = ("--set", "vehicle.plant=kinematic", "--set", "run.duration_s=0.2")
TUNING = f"""scenario = "{PAPER}"
seeds = {{ first = 1, last = 2 }}
quick_seeds = 1
metric = "epsilon_m"
most = 10.0
mean = "geometric"
start = "centre"
searches = 1
evaluations = 4
quick_evaluations = 4
rounds = 1
[set]
vehicle.plant = "kinematic"
run.duration_s = 0.2
[condition."all"]
channel.prr = 0.5
[bounds.pid]
controller.v.p = {{ from = 0.1, to = 3.0, known = [0.5] }}
[law."PID"]
bounds = "pid"
evaluations = 5
controller.law = "pid"
"""
SWEEP = f"""scenario = "{PAPER}"
seeds = 2
[set]
vehicle.plant = "kinematic"
run.duration_s = 0.2
[grid]
channel.prr = [0.5, 1.0]
"""
GAINS = """command = "tether tune"
objective = "epsilon_m"
[law."one"]
version = "1"
conditions = ["all"]
seeds = [1001, 1002]
evaluations = 64
found = [1.5, 1.75]
before = 2.5
after = 1.5
means_before = [2.5]
means_after = [1.5]
[law."one".settings]
[law."one".gains]
controller.v.p = 0.46
"""
PRECISE = f"""scenario = "{PAPER}"
trajectory_period_s = 0.1
[precision]
metric = "epsilon_m"
half_width = 0.01
most_seeds = 20
batch = 10
[set]
vehicle.plant = "kinematic"
run.duration_s = 0.2
[grid]
channel.prr = [0.5, 1.0]
[[table]]
kind = "limit"
title = "how far"
metric = "epsilon_m"
key = "channel.prr"
limit = 0.5
"""
SAFETY = """
[[safety_input]]
name = "field"
function = "protective_stop"
kind = "can"
id = 0x3A0
length = 2
byte = 1
mask = 3
clear = 1
stop = 2
timeout_ms = 100
restart_after_s = 3.0
[[safety_input]]
name = "slow"
function = "speed_limit"
speed_limit_mps = 0.3
kind = "can"
id = 0x3A1
length = 2
byte = 0
mask = 1
clear = 1
timeout_ms = 100
"""
GPIO = """
[[safety_input]]
name = "chain"
function = "estop_status"
kind = "gpio"
chip = "gpiochip0"
line = 5
"""
EXPERIMENTS = ("f3_delay.toml", "handover_share.toml")
PING = "[1700000000.5] 64 bytes from h: icmp_seq=1 ttl=64 time=12.5 ms\n[1700000001.5] 64 bytes from h: icmp_seq=3 ttl=64 time=13 ms\n5 packets transmitted\n"


def drivetrain(name):
    """A drivetrain file with the keys that it shows as comments."""
    text = (SOURCE / "drivetrains" / f"{name}.toml").read_text()
    return re.sub(r"^# (?=\w+ = (?:[\d.]+|\[[\w, ]+\]) +#)", "", text, flags=re.MULTILINE)


def rows(head, *lines, times=30):
    """A CSV file whose first rows are tried, and more that make it long enough."""
    more = [line.format(i) for i in range(len(lines), times) for line in lines[-1:]]
    return "\n".join([head, *(line.format(i) for i, line in enumerate(lines)), *more]) + "\n"


def files(bin_dir, public_key, work):
    """name: (content, lines in which numbers are tried, command with FILE, exit codes but for 2)."""
    run = ("tether", "run", PAPER, *SHORT, "--out", "out")
    hil = ("tether", "run", SOURCE / "scenarios" / "hil_vcan.toml", "--set", "run.duration_s=0.2", "--out", "out", "--set", "can.drivetrain=FILE")
    bridge = ("tether-can-bridge", SOURCE / "scenarios" / "hil_vcan.toml", "--start-utime", "1", "--set", "can.interface=none0", "--set", "can.drivetrain=FILE")
    plain = drivetrain("two_node_cia402")
    inputs = range(plain.count("\n"), 1000)
    room = (SOURCE / "scenarios" / "maps" / "room.yaml").read_text().replace("room.pgm", "hall.pgm")
    (work / "hall.yaml").write_text(room)
    (work / "tuned.toml").write_text(f'scenario = "{PAPER}"\nseeds = 3\ngains = "gains.toml"\n[axis.law."one"]\n')
    (work / "sweep.toml").write_text(SWEEP)
    (work / "measured.csv").write_text("channel.prr,epsilon_m\n0.5,0.27\n0.5,0.28\n")
    for words in (("sweep", "sweep.toml", "--out", "swept"), ("predict", "swept", "--out", "made.json")):
        subprocess.run([bin_dir / "tether", *words], cwd=work, check=True, capture_output=True)
    return {
        "trace.csv": (rows("time_s,delay_ms,prr", "{}.0,5.0,1.0", "{}.5,6.0,0.5", times=4), (1, 2),
                      (*run, "--set", "channel.model=trace", "--set", "channel.trace.file=FILE"), (0,)),
        "fit.csv": (rows("seq,time_s,delay_ms", "{0},{0}.0,5.0", "{0},{0}.5,6.0"), (1, 2), ("tether", "netem", "fit", "FILE"), (0, 1)),
        "fates.csv": (rows("time_s,lost,delay_ms", "{}.0,0,5.0", "{}.5,1,"), (1, 2), ("tether", "netem", "fit", "FILE"), (0, 1)),
        "import.csv": (rows("time_s,delay_ms,loss_percent", "{}.0,5.0,0", "{}.5,6.0,10", times=4), (1, 2), ("tether", "netem", "import", "FILE"), (0,)),
        "import_ns.csv": (rows("time_ns,rtt_us", "{}000,5.0", "{}500,6.0", times=4), (1, 2), ("tether", "netem", "import", "FILE"), (0,)),
        "ping.txt": (PING, (0, 1, 2), ("tether", "netem", "import", "FILE", "--format", "ping"), (0,)),
        "way.csv": ("x_m,y_m\n0,0\n1,0\n1,1\n2,2\n", (1, 2, 3, 4),
                    (*run, "--set", "path.kind=csv", "--set", "path.csv=FILE", "--set", "path.point=axle"), (0,)),
        "room.yaml": ((SOURCE / "scenarios" / "maps" / "room.yaml").read_text(), range(3, 8),
                      (*run, "--set", "map.file=FILE", "--set", "path.kind=line", "--set", "path.length_m=1"), (0,)),
        "scenario.toml": ("[run]\nduration_s = 0.2\nseed = 1\n[vehicle]\nplant = \"kinematic\"\n[sensor]\nrate_hz = 20.0\n"
                          "latency_ms = 5.0\n[channel.uplink]\nprr = 0.5\n", range(10), ("tether", "run", "FILE", "--out", "out"), (0,)),
        "link.toml": (LINK.replace("KEY", public_key), range(30), ("/usr/bin/timeout", "-s", "INT", "-k", "5", "0.6", bin_dir / "tether-link", "run", "FILE"), (0, 124)),
        "experiment.toml": (f'scenario = "{PAPER}"\nseeds = 3\n[set]\nvehicle.plant = "kinematic"\nrun.duration_s = 0.2\n[grid]\n'
                            'channel.prr = [0.5, 1.0]\n', range(10),
                            ("tether", "sweep", "FILE", "--dry-run"), (0,)),
        "precise.toml": (PRECISE, range(30), ("tether", "sweep", "FILE", "--dry-run"), (0,)),
        **{name: ((SOURCE / "experiments" / name).read_text().replace("../scenarios", str(SOURCE / "scenarios")).replace(
            '"gains/', f'"{SOURCE}/experiments/gains/'), range(1000), ("tether", "sweep", "FILE", "--dry-run"), (0,))
           for name in EXPERIMENTS},
        "drivetrain.toml": (drivetrain("zlac8015d"), range(1000), hil, (0,)),
        "cia402.toml": (drivetrain("two_node_cia402"), range(1000), hil, (0,)),
        "dual_axis.toml": (drivetrain("dual_axis_cia402"), range(1000), hil, (0,)),
        "safety.toml": (plain + SAFETY, inputs, hil, (0,)),
        "gpio.toml": (plain + GPIO, inputs, bridge, (1,)),  # there is no such CAN interface
        "agilex.toml": (drivetrain("agilex_v2"), range(1000), hil, (0,)),
        "device.eds": ((SOURCE / "tests" / "fuzz" / "seeds" / "eds" / "two_axes.eds").read_text(), range(1000), ("tether", "can", "import", "FILE"), (0,)),
        "tuning.toml": (TUNING, range(30), ("/bin/sh", "-c", f"rm -rf tuned; exec {bin_dir}/tether tune FILE --quick --jobs=1 --out tuned"), (0,)),
        "gains.toml": (GAINS, range(30), ("tether", "sweep", "tuned.toml", "--dry-run"), (0,)),
        "prediction.json": ((work / "made.json").read_text(), range(60), ("tether", "predict", "--check", "FILE", "measured.csv"), (0, 1)),
        "floor.csv": ("channel.prr,epsilon_m,lost\n0.5,0.27,0\n0.5,0.28,0\n1,0.26,0\n", (1, 2, 3),
                      ("tether", "predict", "--check", "made.json", "FILE"), (0, 1)),
        "tau.csv": ("channel.prr,channel.delay_ms,controller.tau_s,plant,epsilon_m\n0.5,0,1,kinematic,2\n0.5,0,2,kinematic,3\n1,0,1,kinematic,1\n1,0,2,kinematic,2\n", (1, 2, 3, 4),
                    (*run, "--set", "controller.law=pid_adaptive", "--set", "controller.tau_table=FILE"), (0,)),
        "delays.txt": ("1.5\n2.5\n4.0\n", (0, 1), (*run, "--set", "channel.jitter.law=table", "--set", "channel.jitter.file=FILE"), (0,)),
        "snr.asc": ("ncols 2\nnrows 2\nxllcorner -9.0\nyllcorner -9.0\ncellsize 9.0\nNODATA_value -9999\n20.0 25.0\n30.0 35.0\n", range(8),
                    (*run, "--set", "channel.model=map", "--set", "channel.map.file=FILE"), (0,)),
        "hall.pgm": ("P2\n40 30\n255\n" + ("254 " * 40 + "\n") * 30, (1, 2),
                     (*run, "--set", "map.file=hall.yaml", "--set", "path.kind=line", "--set", "path.length_m=1"), (0,)),
    }


def variants(text, lines):
    """Variants to try: (what, content)."""
    all_lines = text.splitlines()
    for number in lines:
        if number >= len(all_lines) or all_lines[number].lstrip().startswith(("#", "[", "PGM")) and "icmp" not in all_lines[number]:
            continue
        code = all_lines[number].split("#")[0]
        for found in NUMBER.finditer(code):
            for value in VALUES:
                changed = code[: found.start()] + value + code[found.end() :]
                yield f"line {number + 1}: {found[0]} -> {value}", "\n".join([*all_lines[:number], changed, *all_lines[number + 1 :]]) + "\n"
        if re.match(r"[\w.]+\s*[=:]", code):
            yield f"line {number + 1} twice", "\n".join([*all_lines[: number + 1], *all_lines[number:]]) + "\n"


def keys_for_numbers():
    """key: the source that reads it, of all files in TOML but for scenarios and records of commissioning."""
    reads = re.compile(r"\b(?:number|whole|integers?|required)\(\s*\"(\w+)\",[^,\"]+,[^\"]*?\d")
    sources = [f for room in ("can_bridge", "doors/link", "tools/experiment/sweep") for f in (SOURCE / room).rglob("*.cpp")]
    left_out = ("_settings.cpp", "_section.cpp", "record.cpp")
    return {key: f.name for f in sources if not f.name.endswith(left_out) for key in reads.findall(f.read_text())}


def check_every_key_is_tried(test, table):
    tried = set()
    for text, lines, *_ in table.values():
        for line in text.splitlines()[lines[0] : lines[-1] + 1]:
            tried.update(re.findall(r"(\w+)\s*=\s*[^=\"]*\d", line.split("#")[0]))
    keys = keys_for_numbers()
    check(len(keys) > 40, f"only {len(keys)} keys found in the readers' sources: {keys}")
    check(not keys.keys() - tried, f"in no file of the table: { {key: keys[key] for key in sorted(keys.keys() - tried)} }")
    test.say(f"{len(keys)} keys for numbers, all in the table")


def every_number_is_refused_or_right(test):
    public_keys = []
    for key in ("own.key", "peer.key"):
        made = test.run("tether-link", "keygen", test.work / key)
        public_keys.append(made.out().strip())
    table = files(test.bin, public_keys[1], test.work)
    check_every_key_is_tried(test, table)
    for name, (text, lines, command, codes) in table.items():
        file = test.work / name
        shutil.copy(SOURCE / "scenarios" / "maps" / "room.pgm", test.work)
        words = [str(word).replace("FILE", str(file)) for word in (test.bin / command[0], *command[1:])]
        file.write_text(text)
        plain = subprocess.run(words, capture_output=True, text=True, cwd=test.work, timeout=SECONDS)
        check(plain.returncode in codes, f"{name} as it is: {plain.returncode} {plain.stdout}{plain.stderr}")
        tried = refused = 0
        for what, content in variants(text, lines):
            file.write_text(content)
            done = subprocess.run(words, capture_output=True, text=True, cwd=test.work, timeout=SECONDS)
            said = done.stdout + done.stderr
            tried += 1
            refused += done.returncode == 2
            check(done.returncode in (*codes, 2), f"{name}, {what}: exit code {done.returncode}: {said[-400:]}")
            check(done.returncode == 2 or not re.search(r"(?<![\w.])-?(nan|inf)\b", said.replace("nan,inf", "")), f"{name}, {what}: {said[:600]}")
            if "twice" in what:
                check(done.returncode == 2, f"{name}, {what}: accepted")
            if done.returncode == 2:
                check(len(done.stderr.strip().splitlines()) == 1, f"{name}, {what}: {done.stderr}")
        test.say(f"{name}: {refused} of {tried} values and lines refused, the others right")


UNBOUNDED = ("--count", "--start-boot")  # any positive number, any time
OPTION = re.compile(r"^  (?:-\w,)?(--[\w-]+) (?:UINT|INT|FLOAT)(?::\w+)?(?: in \[(\S+) - (\S+)\])?", re.MULTILINE)


REQUIRED = re.compile(r"^  (--\S+ |)(?:[a-z]+ )?(TEXT|UINT)(?::\{(\w+)|)\S*(?: \.\.\.)? REQUIRED", re.MULTILINE)


def numeric_options():
    """(command's words with what it requires, option, lower bound, upper bound), bounds None if the help says none."""
    text = (SOURCE / "docs" / "reference" / "commands.md").read_text()
    for block in text.split("```text\n")[1:]:
        usage = re.search(r"^Usage: (\S+(?: [a-z-]+)*)", block, re.MULTILINE)
        block = block.split("```")[0]
        required = [option.strip() + "=" * bool(option) + (choice or {"TEXT": "x", "UINT": "1"}[kind])
                    for option, kind, choice in REQUIRED.findall(block)]
        for option, low, high in OPTION.findall(block) if usage else []:
            yield [*usage[1].split(), *required], option, float(low) if low else None, float(high) if high else None


def every_numeric_option_refuses_what_is_out_of_bounds(test):
    bounded = tried = 0
    for words, option, low, high in numeric_options():
        said = " ".join(words)
        check(low is not None or option in UNBOUNDED, f"{said} {option}: its help says no bounds")
        within = "1" if low is None or low <= 1 <= high else f"{low:g}"
        bad = [[f"{option}={value}"] for value in ("nan", "1e400", "x", "1x", "")]
        if option != "--node":  # CAN commands take several
            bad.append([f"{option}={within}"] * 2)
        if low is not None:
            bounded += 1
            bad += [[f"{option}={value}"] for value in ("inf", "-inf", "-1e308", "1e308", f"{low - 1:.17g}", f"{2 * high + 1:.17g}")]
        for arguments in bad:
            done = subprocess.run([test.bin / words[0], *words[1:], *arguments], capture_output=True, text=True, cwd=test.work,
                                  timeout=SECONDS)
            lines = done.stderr.strip().splitlines()
            tried += 1
            check(done.returncode == 2, f"{said} {arguments}: exit code {done.returncode}: {done.stdout[-300:]}{done.stderr[-300:]}")
            check(len(lines) == 1 and option in lines[0], f"{said} {arguments}: {lines}")
    check(bounded > 50, f"only {bounded} options with bounds")
    test.say(f"{tried} values of {bounded} options with bounds and others, all refused")


main(every_numeric_option_refuses_what_is_out_of_bounds, every_number_is_refused_or_right)
