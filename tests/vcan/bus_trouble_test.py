#!/usr/bin/env -S python3 -B
"""A bus that goes away or misbehaves while the vehicle drives: it stops, the state names the bus,
nothing moves again because the bus came back, and no old setpoint comes out of a queue.
Usage: bus_trouble_test.py BIN_DIR"""

import contextlib
import fcntl
import socket
import struct
import subprocess
import time

from can_drivetrain import NODES, Drivetrain, Record, moves, patient_file, rpdo1, tpdo1
from can_support import CanBus, SerialAdapter, bridged, create_vcan, ip
from live_support import check, main, wait_until

SIOCGIFFLAGS, SIOCSIFFLAGS, IFF_UP = 0x8913, 0x8914, 1  # linux/sockios.h, linux/if.h
RTM_DELLINK, NLM_F_REQUEST = 17, 1  # linux/rtnetlink.h, linux/netlink.h

SPEED_MPS = 1.0
STATE_LIMIT_S = 0.4  # until CAN/STATE says so
# The drives notice after 100 ms (no setpoint) or 250 ms (no heartbeat), 400 and 600 ms on the
# adapter, then brake with 4 m/s².
STAND_LIMIT_S = 1.0
RPDOS = tuple(map(rpdo1, NODES))


class OnAdapter(Drivetrain):
    """The bridge on a serial-line adapter can0; the drives on vcan0, which is the same bus."""

    def _start(self, program):
        interface = "can0" if program == "tether-can-bridge" else "vcan0"
        return super()._start(program, f"can.interface={interface}")


@contextlib.contextmanager
def drivetrain_on_adapter(test):
    adapter = SerialAdapter("can0")
    try:
        with CanBus() as far, OnAdapter(test, patient_file(test)) as d:
            bridged(adapter, far)
            try:
                yield adapter, d
            finally:
                adapter.on_frame = lambda text: None
                adapter.stall(False)
    finally:
        adapter.close()


def wait_bus(d, bus, since, seconds=5):
    return d.wait_for("CAN/STATE", lambda m: m.bus == bus, seconds, f"bus {bus}", since)


def check_stops(d, begin, what, reason, bus):
    """FAULT, quickly, with this reason, and the wheels stand, though commands to drive go on."""
    left = d.wait_for("CAN/STATE", lambda m: m.state_name != "armed", 5, what, begin)
    stand = d.wait_standstill(begin) - begin
    fault = d.wait_state("fault", 5, begin)
    left_s = left.arrival - begin
    d.test.say(
        f"measured: {what} at {SPEED_MPS} m/s: disarmed after {left_s * 1e3:.0f} ms, "
        f"wheels stand after {stand * 1e3:.0f} ms"
    )
    wait_bus(d, bus, begin)
    check(reason in fault.reason, f"{what}: reason {fault.reason!r}")
    check(fault.disarms == 1, f"{what}: {fault.disarms} disarms")
    check(left_s < STATE_LIMIT_S, f"{what}: disarmed after {left_s:.3f} s")
    check(stand < STAND_LIMIT_S, f"{what}: wheels stood after {stand:.3f} s")


def check_stays(d, seconds, state, what):
    """The state is held and the wheels stand, while commands to drive come in."""
    begin = time.time()
    time.sleep(seconds)
    check(d.sent[-1][0] > begin and d.sent[-1][1] != 0.0, "no command to drive")
    names = {m.state_name for m in d.network.messages("CAN/STATE", begin)}
    check(names == {state}, f"{what}: states {names}, not {state}")
    d.check_still(begin, what)


def check_arms_again(d, what):
    """RESET leads to disarmed and no further, though commands to drive come in; only then ARM, with
    a zero command, leads to driving."""
    reset = d.request("reset")
    d.wait_state("disarmed", 15, since=reset)
    check_stays(d, 0.5, "disarmed", f"{what}, after RESET")
    d.check_still(reset, f"{what}, after RESET")
    names = set(d.states(reset))
    check(names <= {"fault", "starting", "disarmed"}, f"{what}: states after RESET: {names}")
    arm = time.time()
    d.arm()
    d.drive(SPEED_MPS)
    return arm


def check_none_moves(setpoints, what):
    setpoints = list(setpoints)
    moving = [f for f in setpoints if moves(f)]
    check(not moving, f"{what}: {len(moving)} of {len(setpoints)} setpoints move a wheel")
    return len(setpoints)


def check_recovers(d, up, what):
    """From the interface's return on, whose record shows that nothing moves before ARM."""
    record = Record(d.test, "recovery")
    wait_bus(d, "up", up)
    check_stays(d, 1.0, "fault", what)
    arm = check_arms_again(d, what)
    record.stop()
    before = check_none_moves(record.frames(*RPDOS, until=arm), f"{what}, before ARM")
    check(before > 10, f"{what}: {before} setpoints before ARM")
    check(any(map(moves, record.frames(*RPDOS, since=arm))), f"{what}: no setpoint moves after ARM")


# Without a program of its own, whose start alone would make a slow machine late.


def take_down(interface):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        name = interface.encode()
        request = fcntl.ioctl(s, SIOCGIFFLAGS, struct.pack("16sH14x", name, 0))
        flags = struct.unpack_from("H", request, 16)[0]
        fcntl.ioctl(s, SIOCSIFFLAGS, struct.pack("16sH14x", name, flags & ~IFF_UP))


def delete(interface):
    index = socket.if_nametoindex(interface)
    info = struct.pack("BxHiII", socket.AF_UNSPEC, 0, index, 0, 0)
    header = struct.pack("IHHII", 16 + len(info), RTM_DELLINK, NLM_F_REQUEST, 1, 0)
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as s:
        s.send(header + info)


def last_frame(record):
    """When the interface went away, 20 ms at most before."""
    record.stop()
    return record.frames()[-1].timestamp


def the_interface_goes_down_and_up(test):
    with Drivetrain(test) as d:
        record = Record(test, "interface_down")
        d.bring_up(SPEED_MPS)
        take_down("vcan0")
        check_stops(d, last_frame(record), "interface down", "CAN interface down", "down")
        reset = d.request("reset")
        d.wait_state("fault", 5, reset, "reset refused: the CAN interface is down")
        up = time.time()
        ip("set vcan0 up")
        check_recovers(d, up, "interface up again")
        for channel in ("CAN/COUNTERS", "CAN/DRIVE_COUNTERS"):
            check(d.counters(channel)["can.reopened"] == 0, f"{channel}: reopened")


def the_interface_is_deleted_and_made_again(test):
    with Drivetrain(test) as d:
        record = Record(test, "interface_deleted")
        d.bring_up(SPEED_MPS)
        delete("vcan0")
        check_stops(d, last_frame(record), "interface deleted", "CAN interface", "absent")
        up = time.time()
        create_vcan("vcan0")
        check_recovers(d, up, "interface made again")
        for channel in ("CAN/COUNTERS", "CAN/DRIVE_COUNTERS"):
            reopened = d.counters(channel)["can.reopened"]
            check(reopened == 1, f"{channel}: reopened {reopened} times")
        check(d.drives.running() and d.bridge.running(), "a program has ended")


class BehindGateway(Drivetrain):
    """The bridge on vcan0, the drives on vcan1; the kernel's gateway is the cable between them."""

    def _start(self, program):
        interface = "vcan0" if program == "tether-can-bridge" else "vcan1"
        return super()._start(program, f"can.interface={interface}")


def plug_in():
    for a, b in (("vcan0", "vcan1"), ("vcan1", "vcan0")):
        subprocess.run(["cangw", "-A", "-s", a, "-d", b, "-e"], check=True)


def the_cable_is_pulled(test):
    plug_in()
    with BehindGateway(test) as d:
        record = Record(test, "cable_pulled")
        d.bring_up(SPEED_MPS)
        subprocess.run(["cangw", "-F"], check=True)
        time.sleep(0.1)
        record.stop()
        begin = record.frames(*map(tpdo1, NODES))[-1].timestamp  # the last to come through
        check_stops(d, begin, "cable pulled", "CAN plug", "up")
        plug_in()
        check_stays(d, 1.0, "fault", "cable plugged in")
        check_arms_again(d, "cable pulled")
    subprocess.run(["cangw", "-F"], check=True)


def the_controller_is_error_passive_then_off(test):
    with drivetrain_on_adapter(test) as (adapter, d):
        d.start_drives()
        d.start_bridge()
        d.hold(0.0)
        d.wait_state("disarmed", 15)
        # Error-passive: no arming, but what is armed goes on.
        since = time.time()
        adapter.error_passive()
        d.wait_state("disarmed", 5, since, "error-passive: check wiring")
        d.request("arm")
        d.wait_state("disarmed", 5, since, "arming refused: the CAN bus is error-passive")
        adapter.error_active()
        wait_bus(d, "up", time.time())
        d.arm()
        d.drive(SPEED_MPS)
        since = time.time()
        adapter.error_passive()
        wait_bus(d, "error-passive", since)
        time.sleep(0.3)
        check(d.states(since) == ["armed"], f"error-passive: {d.states(since)}")
        adapter.error_active()
        wait_bus(d, "up", time.time())

        off = time.time()
        adapter.bus_off()
        check_stops(d, off, "bus-off", "CAN bus-off", "bus-off")
        check_stays(d, 0.5, "fault", "bus-off")
        active = time.time()
        adapter.error_active()
        check_stays(d, 1.0, "fault", "error-active again after bus-off")
        check_none_moves(adapter.setpoints(RPDOS, off + 0.1), "during bus-off")
        arm = check_arms_again(d, "bus-off")
        check(check_none_moves(adapter.setpoints(RPDOS, active, arm), "after bus-off") > 10, "no setpoints")
        check(d.counters()["can.restarts"] == 1, "not one restart")


def the_adapter_stalls(test):
    with drivetrain_on_adapter(test) as (adapter, d):
        d.bring_up(SPEED_MPS)
        stall = time.time()
        adapter.stall()
        check_stops(d, stall, "adapter stalls", "", "stalled")
        check_stays(d, 0.5, "fault", "adapter stalls")
        go_on = time.time()
        adapter.stall(False)
        # One frame had left the kernel already; whatever the bridge does, the adapter sends it.
        wait_until(5, lambda: adapter.frames[-1][0] > go_on, "the adapter works again")
        taken = next(arrival for arrival, _ in adapter.frames if arrival > go_on)
        check_stays(d, 1.0, "fault", "adapter works again")
        arm = check_arms_again(d, "stall")
        count = check_none_moves(adapter.setpoints(RPDOS, taken, arm), "more than 100 ms old")
        check(count > 10, f"{count} setpoints after the stall")


main(
    the_interface_goes_down_and_up,
    the_interface_is_deleted_and_made_again,
    the_cable_is_pulled,
    the_controller_is_error_passive_then_off,
    the_adapter_stalls,
)
