#!/usr/bin/env -S python3 -B
"""The bridge with drives whose CANopen is of another author and in another language (canopen_drive/).
Its packages are in tests/vcan/npm of the build folder (canopen_drive/install.py).
Usage: canopen_drive_test.py BIN_DIR"""

import pathlib
import shutil
import sys

from can_drivetrain import TWO_NODES
from independent_drivetrain import HERE, Independent
from live_support import check, main

NPM = pathlib.Path(sys.argv[1]).resolve().parent / "tests" / "vcan" / "npm"


class Canopen(Independent):
    program = HERE / "canopen_drive"

    def __init__(self, test, drivetrain=TWO_NODES):
        check((NPM / "installed").exists(), f"run {self.program}/install.py {NPM}")
        super().__init__(test, NPM, drivetrain=drivetrain)


def is_driven_and_stopped_by_the_bridge(test):
    with Canopen(test) as agv:
        agv.start_up()
        agv.drive_and_stop()
        check(not agv.reports("what"), f"npm's canopen threw: {agv.reports('what')[:1]}")


def stops_by_its_heartbeat_consumer_when_the_bridge_is_killed(test):
    """It has no deadline of setpoints (0x1400:5), which the file calls optional."""
    with Canopen(test) as agv:
        agv.start_up()
        agv.check_stop_without_bridge(["quick stop active", "switch on disabled"])


def is_read_by_the_probe(test):
    with Canopen(test) as agv:
        agv.start_up()
        probe = test.run("tether", "can", "probe", "--interface", "vcan0", "--drivetrain", TWO_NODES,
                         seconds=20)
        check(probe.process.returncode == 0, probe.out())
        check("fits, as far as reading can tell" in probe.out(), probe.out())


# Values that no data sheet has for this vehicle (two_node_cia402.toml has the same drives).
FILLED_IN = {
    "left.sign": "sign = 1", "right.sign": "sign = -1",
    "target_velocity_per_rps": "target_velocity_per_rps = 12000",
    "actual_velocity_per_rps": "actual_velocity_per_rps = 12000",
    "counts_per_revolution": "counts_per_revolution = 81920",
    "value of 0x6083:00 u32": "value = 14400", "value of 0x6084:00 u32": "value = 19200",
    "value of 0x6085:00 u32": "value = 19200",
}


def is_driven_by_a_file_that_was_made_from_its_data_sheet(test):
    """Which is refused as it is; what was named as missing is all that it lacks."""
    sheet = test.work / "drive.eds"
    written = test.run(shutil.which("node"), NPM / "drive.mjs", 1, sheet, seconds=20)
    check(written.process.returncode == 0, written.err())
    made = test.run("tether-vehicle", "can", "import", sheet, "--node", 1, "--node", 2)
    check(made.process.returncode == 0, made.err())
    missing = [line.removeprefix("missing: ") for line in made.err().splitlines()]
    file = test.work / "made.toml"
    lines = made.out().splitlines()
    for i, what in enumerate(missing):
        file.write_text("\n".join(lines))
        refused = test.run("tether-vehicle", "can", "probe", "--interface", "vcan0", "--drivetrain", file, seconds=20)
        check(refused.process.returncode == 2 and "made.toml:" in refused.err(), f"without {what}: {refused.err()}")
        (value,) = (text for name, text in FILLED_IN.items() if name in what)
        lines[lines.index(f"# MISSING: {what}")] = value
    file.write_text("\n".join(lines))
    test.say(f"{len(missing)} values filled in, {len(lines)} lines")
    with Canopen(test, drivetrain=file) as agv:
        agv.start_up()
        agv.drive_and_stop()


main(
    is_driven_by_a_file_that_was_made_from_its_data_sheet,
    is_driven_and_stopped_by_the_bridge,
    stops_by_its_heartbeat_consumer_when_the_bridge_is_killed,
    is_read_by_the_probe,
)
