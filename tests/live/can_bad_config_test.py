#!/usr/bin/env -S python3 -B
"""Wrong drivetrain files and settings are refused before anything runs, with a
message that names the culprit. Usage: can_bad_config_test.py BIN_DIR"""

from live_support import SOURCE, check, main

HIL = SOURCE / "scenarios" / "hil_vcan.toml"
TWO_NODES = SOURCE / "drivetrains" / "two_node_cia402.toml"


def refused(test, code, texts, *command):
    """The command ends at once with `code` and one message on stderr that contains all `texts`."""
    program = test.run(*command, seconds=15)
    message = "\n".join(line for line in program.err().splitlines() if line.startswith(("tether", "  ")))
    said = " ".join(str(part) for part in command)
    check(program.process.returncode == code, f"{said}: exit code {program.process.returncode}\n{program.err()}")
    check("terminate" not in program.err() and "Assertion" not in program.err(), program.err())
    for text in texts:
        check(text in program.err(), f"{said}: no {text!r} in:\n{program.err()}")
    return program.err().strip().splitlines()[-1]


def bad_drivetrains(test):
    """Exit code 2; the message names file, line and key."""
    good = TWO_NODES.read_text()
    cases = [  # replaced text, new text, the line's text, the message
        ("node = 0x7F ", "node = 300 ", "node = 300", ["bridge.node = 300", "1 to 127"]),
        ("sign = -1", "sign = 2", "sign = 2", ["right.sign = 2", "1 or -1"]),
        ("sign = 1 ", "sing = 1 ", "sing = 1", ['unknown key "left.sing"', "sign"]),
        ("standstill_radps = 0.05", "standstill_radps = nan", "standstill_radps", ["drives.standstill_radps = nan"]),
        ("sync = true", 'sync = "yes"', "sync =", ["bridge.sync", "true or false"]),
        ("heartbeat_timeout_ms = 300", "heartbeat_timeout_ms = 200", "[drives]", ["drives.heartbeat_timeout_ms = 200", "300"]),
        ("\ntimeout_ms = 250", "\ntimeout_ms = 0", "timeout_ms = 0", ["watchdog.timeout_ms = 0", "30 to 1000"]),
        ("\ntimeout_ms = 250", "\ntimeout_ms = 100", "[[watchdog]]", ["watchdog.timeout_ms = 100", "180"]),
        ('kind = "heartbeat_consumer"', 'kind = "none"', "kind =", ["watchdog.kind", "heartbeat_consumer"]),
        ("[[watchdog]]\nnode = [1, 2]", "[[watchdog]]\nnode = 1", "[right]", ["node 2 (right axis) has no [[watchdog]]"]),
        ('"0x6083:00 u32"', '"0x6083 u32"', "0x6083 u32", ["setup.object", "0x60FF:00 i32"]),
        ("value = 14400", "value = 4294967296", "value = 4294967296", ["setup.value = 4294967296"]),
        ("value = 14400", "value = 1.5", "value = 1.5", ["setup.value = 1.5", "whole number"]),
        ("counts_per_revolution = 81920", "counts_per_revolution = 0", "counts_per_revolution = 0", ["left.counts_per_revolution = 0"]),
        ("rpdo = 1\n", "rpdo = 5\n", "rpdo = 5", ["pdo.rpdo = 5", "1 to 4"]),
        ("rpdo = 1\n", "rpdo = 1\ntpdo = 1\n", "[[pdo]]", ["either rpdo", "or tpdo"]),
        ('"controlword", "target_velocity"', '"controlword", "target_speed"', "target_speed", ["target_speed", "left.controlword"]),
        ('objects = ["controlword", "target_velocity"]', 'objects = ["controlword"]', "[left]", ["carries left.target_velocity"]),
        ('"actual_position", "error_code", "mode_display"', '"actual_position", "error_code", "actual_velocity"', "[[pdo]]", ["bytes of objects", "at most 8"]),
        ("[left]\nnode = 1", "[left]\nnode = 127", "node = 127", ["left.node = 127", "1 to 126"]),
        ("node = 0x7F ", "node = 1 ", "[left]", ["left.node = 1 is the bridge's own"]),
        ("[right]\nnode = 2", "[right]\nnode = 1", "objects =", ["left.controlword", "both axes are on node 1"]),
        ('profile = "cia402"', 'profile = "cia403"', "profile =", ["profile", '"cia402" or "agilex_v2"']),
        ("[left]", "[left", "[left", []),
    ]
    for number, (old, new, line_text, texts) in enumerate(cases):
        check(old in good, f"{TWO_NODES.name} has no {old!r}")
        text = good.replace(old, new, 1)
        path = test.work / f"bad_{number}.toml"
        path.write_text(text)
        program = ("tether-can-bridge", "tether-can-drive")[number % 2]
        command = (program, HIL, "--set", f"can.drivetrain={path}", "--start-utime", "1")
        message = refused(test, 2, [f"{path}:", *texts], *command)
        line = int(message.split(f"{path}:")[1].split(":")[0])
        check(line_text in text.splitlines()[line - 1], f"line {line} for {line_text!r}: {message}")
    test.say(f"{len(cases)} bad drivetrain files refused; such as: {message}")


def bad_options(test):
    cases = {
        "can.drivetrain=/nowhere.toml": ['cannot read the drivetrain file "/nowhere.toml"'],
        "can.stale_ms=0": ["can.stale_ms", "0", "1"],
        "can.disarm_ms=0": ["can.disarm_ms"],
        "can.disarm_ms=150": ["can.stale_ms < can.disarm_ms", "150"],
        "can.stale_ms=30": ["2 * can.cycle_ms <= can.stale_ms"],
        "can.max_blind_s=0.18": ["can.max_blind_s = 0.18 must be above 0.18", "brakes"],
        "can.cycle_ms=0": ["can.cycle_ms"],
        "can.max_speed_mps=nan": ["can.max_speed_mps"],
        "can.max_speed_mps=-1": ["can.max_speed_mps"],
        "can.max_deceleration_mps2=1": ["stopping must not be weaker than accelerating", "can.max_deceleration_mps2"],
        "can.max_jerk_mps3=0": ["can.max_jerk_mps3"],
        "can.wheels=square": ["can.wheels", "sim", "model"],
        "can.emulate_drives=false": ['can.arm = "once"', 'it must be "never"', "tether can arm"],
        "can.arm=always": ["can.arm", "once", "never"],
        "can.speed=1": ["can.speed"],
        "can.interface=can/0": ['CAN interface "can/0"', "such as can0 or vcan0"],
        "can.interface=an_interface_of_the_kernel": ["1 to 15 characters"],
        "vehicle.drivetrain=direct": ["vehicle.drivetrain", '"can"'],
    }
    for setting, texts in cases.items():
        message = refused(test, 2, texts, "tether-can-bridge", HIL, "--set", setting, "--start-utime", "1")
    test.say(f"{len(cases)} bad settings refused; such as: {message}")


def bad_injections(test):
    """They would do nothing, silently."""
    cases = {
        ("can.inject=fault", "can.inject_node=300"): ["can.inject_node = 300", "allowed: 0 (all), 1, 2"],
        ("can.inject=wheel_slip",): ["wheel_slip", "can.inject_value = 0", "above 0, up to 1"],
        ("can.inject=wheel_slip", "can.inject_value=2"): ["can.inject_value = 2", "up to 1"],
        ("can.inject=safety_input", "can.inject_value=3"): ["can.inject_value = 3", "2 (makes no sense)"],
        ("can.inject=safety_input", "can.inject_node=1"): ["can.inject_node = 1", "no such safety input"],
    }
    for settings, texts in cases.items():
        options = [part for s in settings for part in ("--set", s)]
        refused(test, 2, texts, "tether", "run", HIL, *options)


def slow_motion_of_real_drives(test):
    """The bridge's deadlines would take longer, but not what the vehicle does meanwhile."""
    text = ["--speed 0.5: slow motion stretches the bridge's time-outs: only with can.emulate_drives = true"]
    slow = ("--start-utime", "1", "--speed", "0.5")
    real = ("--set", "can.emulate_drives=false", "--set", "can.arm=never")
    refused(test, 2, text, "tether-can-bridge", HIL, *real, *slow)
    emulated = test.run("tether-can-bridge", HIL, "--set", "can.interface=vcan9", *slow)
    check("slow motion" not in emulated.err(), emulated.err())


def too_loose_for_real_drives(test):
    cases = {
        "can.max_blind_s=11": ["can.max_blind_s = 11", "at most 10", "without a fresh pose"],
        "can.max_blind_m=11": ["can.max_blind_m = 11", "at most 10"],
        "can.stale_ms=1001": ["can.stale_ms = 1001", "at most 1000", "an old command is followed"],
        "can.max_stale_m=2.1": ["can.max_stale_m = 2.1", "at most 2"],
        "can.disarm_ms=5001": ["can.disarm_ms = 5001", "at most 5000"],
    }
    real = ("--set", "can.emulate_drives=false", "--set", "can.arm=never")
    for setting, texts in cases.items():
        options = ("--set", "can.disarm_ms=5000", "--set", setting, "--start-utime", "1")
        texts = [*texts, "with real drives (can.emulate_drives = false)"]
        refused(test, 2, texts, "tether-can-bridge", HIL, *real, *options)


def a_node_that_cannot_start_ends_a_live_run(test):
    """Without a CAN interface; it is not tried again and again."""
    program = test.run("tether", "live", HIL, "--set", "can.interface=vcan9", seconds=15)
    check(program.process.returncode == 1, f"exit code {program.process.returncode}\n{program.err()}")
    errors = [line for line in program.err().splitlines() if ": error: " in line]
    check("starting it again" not in program.err(), program.err())
    nodes = [line.split(":")[0] for line in errors if not line.startswith("tether:")]
    check(nodes and len(nodes) == len(set(nodes)), f"repeated: {errors}")
    check("did not start (exit code 1)" in errors[-1], errors[-1])
    test.say(errors[0])


main(
    bad_drivetrains,
    bad_options,
    bad_injections,
    slow_motion_of_real_drives,
    too_loose_for_real_drives,
    a_node_that_cannot_start_ends_a_live_run,
)
