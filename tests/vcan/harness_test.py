#!/usr/bin/env -S python3 -B
"""The foundations of the tests on a real CAN bus work: LCM between processes, the bus as python-can,
candump and Wireshark see it, and a CAN controller with its error states.
Usage: harness_test.py BIN_DIR"""

import time

from can_support import CanBus, Candump, SerialAdapter, bridged, ip, tshark
from live_support import POSE, Network, check, main, wait_until


def lcm_reaches_other_sockets(test):
    other = Network()
    other.send("AGV/POSE", POSE.encode(seq=7))
    message = wait_until(5, lambda: test.network.last("AGV/POSE"), "a pose")
    other.close()
    check(message.seq == 7, "another pose")


def wireshark_reads_the_record(test):
    record = Candump(test, "harness")
    with CanBus() as bus, CanBus() as ear:
        bus.send(0x000, b"\x81\x01")
        bus.send(0x701, b"\x00")
        bus.send(0x601, bytes.fromhex("23161001FA007F00"))
        bus.send(0x581, bytes.fromhex("8016100100000206"))
        bus.send(0x081, bytes.fromhex("308110"))
        ear.wait(0x081, since=0.0)
    log = record.stop()
    before = time.monotonic()
    fields = ("nmt_ctrl.cd", "nmt_ctrl.node_id", "sdo.main_idx", "sdo.data.bytes", "sdo.abort_code")
    rows = tshark(
        log, "can.id", *(f"canopen.{f}" for f in fields), "_ws.malformed", where="can.flags.xtd == 0"
    )
    test.say(f"one run of tshark: {time.monotonic() - before:.1f} s")
    for row in rows:
        test.say("  ".join(row))
    frames = {int(row[0], 0): row[1:] for row in rows}
    check(list(frames) == [0x000, 0x701, 0x601, 0x581, 0x081], "other frames")
    check(frames[0x000] == ("0x81", "0x01", "", "", "", ""), "NMT reset")
    check(frames[0x601] == ("", "", "0x1016", "fa007f00", "", ""), "SDO write")
    check(frames[0x581] == ("", "", "0x1016", "", "0x06020000", ""), "SDO abort")
    check(frames[0x081][-1], "three bytes pass for an emergency message")


def a_controller_has_states_and_a_queue(test):
    adapter = SerialAdapter("can0")
    with CanBus("can0") as bus, CanBus() as far, CanBus() as ear:
        bridged(adapter, far)
        bus.send(0x201, b"\x01\x02")
        check(bytes(ear.wait(0x201, since=0.0).data) == b"\x01\x02", "to the other bus")
        adapter.receive(0x181, b"\x03")
        check(bytes(bus.wait(0x181, since=0.0).data) == b"\x03", "from the adapter")
        adapter.bus_off()
        wait_until(5, bus.error_frames, "an error frame")
        ip("set can0 down")
        ip("set can0 up")
    adapter.close()


main(lcm_reaches_other_sockets, wireshark_reads_the_record, a_controller_has_states_and_a_queue)
