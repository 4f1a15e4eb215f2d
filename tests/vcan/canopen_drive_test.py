#!/usr/bin/env -S python3 -B
"""The bridge with drives whose CANopen is of another author and in another language (canopen_drive/).
Its packages are in tests/vcan/npm of the build folder (canopen_drive/install.py).
Usage: canopen_drive_test.py BIN_DIR"""

import pathlib
import sys

from can_drivetrain import TWO_NODES
from independent_drivetrain import HERE, Independent
from live_support import check, main

NPM = pathlib.Path(sys.argv[1]).resolve().parent / "tests" / "vcan" / "npm"


class Canopen(Independent):
    program = HERE / "canopen_drive"

    def __init__(self, test):
        check((NPM / "installed").exists(), f"run {self.program}/install.py {NPM}")
        super().__init__(test, NPM)


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


main(
    is_driven_and_stopped_by_the_bridge,
    stops_by_its_heartbeat_consumer_when_the_bridge_is_killed,
    is_read_by_the_probe,
)
