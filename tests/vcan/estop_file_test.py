#!/usr/bin/env -S python3 -B
"""A latched e-stop outlives whatever ends the bridge, with drives that were written from the standard
alone: a full disk, a deleted file, kill -9. Usage: estop_file_test.py BIN_DIR"""

import os
import signal
import subprocess
import time

from independent_drivetrain import Independent
from live_support import check, main, wait_until

SPEED_MPS = 0.3


class Remembering(Independent):
    """The bridge keeps its e-stop in `file`."""

    def __init__(self, test, file):
        super().__init__(test)
        self.file = file
        self.settings += (f"can.estop_file={file}",)

    def start_pressed(self, why):
        """A bridge that starts with the e-stop pressed, because of this."""
        since = time.time()
        self.start_bridge()
        reason = self.wait_state("estop", 20, since).reason
        check(reason.startswith("e-stop pressed (from the start: ") and why in reason, reason)

    def release_and_reset(self):
        self.request("estop_release")
        self.wait_state("estop", 5, reason="e-stop released: reset to go on")
        self.request("reset")
        self.wait_state("disarmed", 20)

    def bring_to_speed(self):
        self.release_and_reset()
        self.arm()
        self.hold(SPEED_MPS)
        self._wait(5, lambda: min(self.rims_mps()[-1][1:]) > 0.9 * SPEED_MPS, "it drives")

    def restart(self, number=signal.SIGKILL):
        self.bridge.kill(number)
        code = self.bridge.wait(20)
        self.wait_for_standstill()
        self.hold(0.0)
        return code


def a_full_disk_forgets_no_estop(test):
    """Pressed on a full disk, then killed: still pressed at the next start."""
    folder = test.work / "tiny"
    folder.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", folder], check=True)
    try:
        with Remembering(test, folder / "estop") as agv:
            agv.start_pressed("did not exist")
            agv.bring_to_speed()
            fill(folder / "other")
            asked = agv.request("estop")
            agv.wait_state("estop", 5, since=asked)
            agv.restart()
            agv.start_pressed("latched when the bridge ended")
    finally:
        subprocess.run(["umount", "--lazy", folder], check=False)


def fill(path):
    with open(path, "wb", buffering=0) as file:
        for size in (4096, 1):
            try:
                while True:
                    file.write(bytes(size))
            except OSError:
                pass


def a_killed_bridge_starts_latched_and_one_that_ended_does_not(test):
    with Remembering(test, test.work / "state" / "estop") as agv:
        agv.start_pressed("did not exist")
        agv.bring_to_speed()
        agv.restart()
        agv.start_pressed("has no proof of a clean end")
        agv.bring_to_speed()
        code = agv.restart(signal.SIGTERM)
        check(code == 0, f"the bridge ended with {code}: {agv.bridge.err()}")
        since = time.time()
        agv.start_bridge()
        agv.wait_state("disarmed", 20, since)
        check("estop" not in agv.states(since), f"{agv.states(since)}")


def a_deleted_file_is_told_at_once_and_nothing_is_released_or_armed(test):
    with Remembering(test, test.work / "state" / "estop") as agv:
        agv.start_pressed("did not exist")
        agv.bring_to_speed()
        os.remove(agv.file)
        removed = time.time()
        told = f'the e-stop is not remembered: "{agv.file}" was deleted'
        state = agv.wait_state("armed", 2, removed, told)
        test.say(f"measured: the file deleted -> told in CAN/STATE: {state.arrival - removed:.3f} s")
        check(state.arrival - removed < 0.1, f"told after {state.arrival - removed:.3f} s")
        agv.request("disarm")
        agv.wait_state("disarmed", 5, removed)
        agv.hold(0.0)
        time.sleep(0.2)
        agv.request("arm")
        agv.wait_state("disarmed", 2, reason=f"arming refused: {told}")
        agv.request("estop")
        agv.wait_state("estop", 2)
        agv.request("estop_release")
        agv.wait_state("estop", 2, reason="release refused")
        agv.restart()
        agv.start_pressed("did not exist")


def a_fifo_or_a_device_is_refused_and_not_waited_for(test):
    fifo = test.work / "fifo"
    os.mkfifo(fifo)
    for path, what in ((fifo, "it is a FIFO"), ("/dev/null", "it is a device")):
        with Remembering(test, path) as agv:
            since = time.time()
            agv.start_bridge(wait=False)
            wait_until(5, lambda: not agv.bridge.running(), f"the bridge refuses {path}")
            said = agv.bridge.err()
            check(agv.bridge.process.returncode == 2 and what in said, said)
            check(not agv.network.messages("CAN/STATE", since), "it ran")


main(
    a_full_disk_forgets_no_estop,
    a_killed_bridge_starts_latched_and_one_that_ended_does_not,
    a_deleted_file_is_told_at_once_and_nothing_is_released_or_armed,
    a_fifo_or_a_device_is_refused_and_not_waited_for,
)
