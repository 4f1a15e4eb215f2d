#!/usr/bin/env -S python3 -B
"""Every numeric option of every command has its bounds in its help and refuses what is outside of them, what is not a number,
and a second value, with exit code 2 and one line that names it.

Every number of every file that is read is tried with 0, -1, huge, tiny and undefined values, and every line
that names a key with a second one: refused with exit code 2 and one line that names the file, or right, which is an
exit code that the command may have and no inf or nan in what it says.
Usage: numbers_test.py BIN_DIR"""

import re
import shutil
import subprocess

from live_support import PAPER, SOURCE, check, main

VALUES = ("0", "-1", "1e308", "-1e308", "1e-308", "nan", "inf", "9223372036854775807", "1e400", "")
SECONDS = 60
NUMBER = re.compile(r"(?<![\w.\"'-])-?\d+\.?\d*(?:e-?\d+)?(?![\w.\"'])")
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
PING = "[1700000000.5] 64 bytes from h: icmp_seq=1 ttl=64 time=12.5 ms\n[1700000001.5] 64 bytes from h: icmp_seq=3 ttl=64 time=13 ms\n5 packets transmitted\n"


def rows(head, *lines, times=30):
    """A CSV file whose first rows are tried, and more that make it long enough."""
    more = [line.format(i) for i in range(len(lines), times) for line in lines[-1:]]
    return "\n".join([head, *(line.format(i) for i, line in enumerate(lines)), *more]) + "\n"


def files(bin_dir, public_key):
    """name: (content, lines in which numbers are tried, command with FILE, exit codes but for 2)."""
    run = ("tether", "run", PAPER, *SHORT, "--out", "out")
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
        "drivetrain.toml": ((SOURCE / "drivetrains" / "zlac8015d.toml").read_text(), range(1000),
                            ("tether", "run", SOURCE / "scenarios" / "hil_vcan.toml", "--set", "run.duration_s=0.2", "--out", "out",
                             "--set", "can.drivetrain=FILE"), (0,)),
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


def every_number_is_refused_or_right(test):
    public_keys = []
    for key in ("own.key", "peer.key"):
        made = test.run("tether-link", "keygen", test.work / key)
        public_keys.append(made.out().strip())
    for name, (text, lines, command, codes) in files(test.bin, public_keys[1]).items():
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
