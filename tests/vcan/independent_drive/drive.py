"""One axis of a drive: the state machine of the power drive system, profile velocity mode and the
wheel behind the gear (CiA 402 = IEC 61800-7-201)."""

import itertools
import math

from objects import INVALID_VALUE, Abort
from wheel import RADIUS_M, Wheel

# Statusword bits of each state (mask 0x6F), and names as in the standard.
NOT_READY, SWITCH_ON_DISABLED, READY, SWITCHED_ON = 0x00, 0x40, 0x21, 0x23
ENABLED, QUICK_STOP, FAULT_REACTION, FAULT = 0x27, 0x07, 0x0F, 0x08
NAMES = {
    NOT_READY: "not ready to switch on",
    SWITCH_ON_DISABLED: "switch on disabled",
    READY: "ready to switch on",
    SWITCHED_ON: "switched on",
    ENABLED: "operation enabled",
    QUICK_STOP: "quick stop active",
    FAULT_REACTION: "fault reaction active",
    FAULT: "fault",
}
PROFILE_VELOCITY = 3

SELF_TEST_S = 0.05
MAGNETISING_S = 0.04  # from "switch on" to SwitchedOn, and from there to OperationEnabled
GEAR = 20
UNITS_PER_RPS = 600  # 0.1 rpm of the motor
COUNTS = 4096  # counts of the encoder per revolution of the motor
UNITS_PER_MPS = GEAR * UNITS_PER_RPS / (2 * math.pi * RADIUS_M)
BLINK_S = 0.03


class Drive:
    """`device` carries its objects and its emergency messages."""

    def __init__(self, device, options):
        self._device = device
        self._options = options
        self._warnings = itertools.cycle(options.warnings) if options.warnings else None
        self._wheel = Wheel(options)
        self._blink_s = 0.0
        self.power_on()

    def add_objects(self, objects):
        self._objects = objects
        add = objects.add
        add(0x6007, 0, "i16", 1, check=self._one_of(0, 1, 2, 3))
        add(0x603F, 0, "u16", 0, "ro", "t")
        add(0x6040, 0, "u16", 0, pdo="rt", written=self._control)
        add(0x6041, 0, "u16", 0, "ro", "t")
        add(0x605A, 0, "i16", 2, check=self._one_of(0, 1, 2, 5, 6))
        add(0x605E, 0, "i16", 2, check=self._one_of(0, 1, 2))
        add(0x6060, 0, "i8", 0, pdo="rt", check=self._one_of(0, PROFILE_VELOCITY))
        add(0x6061, 0, "i8", 0, "ro", "t")
        add(0x6064, 0, "i32", 0, "ro", "t")
        add(0x606C, 0, "i32", 0, "ro", "t")
        add(0x607F, 0, "u32", 30000, pdo="r")
        for index, default in ((0x6083, 12000), (0x6084, 12000), (0x6085, 24000)):
            add(index, 0, "u32", default, pdo="r", check=self._positive)
        add(0x60FF, 0, "i32", 0, pdo="rt")
        add(0x6502, 0, "u32", 1 << PROFILE_VELOCITY - 1, "ro")

    def _one_of(self, *values):
        def check(value):
            if value not in values:
                raise Abort(INVALID_VALUE)

        return check

    def _positive(self, value):
        if value == 0:
            raise Abort(INVALID_VALUE)

    # --- states

    def power_on(self):
        self.state = NOT_READY
        self._self_test_s = SELF_TEST_S
        self._controlword = 0
        self._wait_s = 0.0
        self._next = None  # the state that the power stage is on its way to
        self._demand = 0.0
        self._error = 0
        self._warning_left_s = self._options.warn_every_s

    @property
    def _speed(self):
        """Speed of the motor, in 0.1 rpm."""
        return self._wheel.rim_mps * UNITS_PER_MPS

    @property
    def powered(self):
        return self.state in (ENABLED, QUICK_STOP, FAULT_REACTION)

    def _enter(self, state):
        if state == self.state:
            return
        if state == ENABLED:
            self._demand = self._speed
        self.state = state
        self._next = None
        self._device.tell(node=self._device.node, event="state", state=NAMES[state])

    def _enter_later(self, state):
        if self._next != state:
            self._next, self._wait_s = state, MAGNETISING_S

    def _control(self, word):
        """Each write of the controlword: one command, one transition."""
        rising = word & ~self._controlword & 0x80
        self._controlword = word
        if self.state == FAULT:
            if rising:
                self._acknowledge()
        elif self.state not in (NOT_READY, FAULT_REACTION):
            self._command(word)

    def _command(self, word):
        if not word & 0x02:  # disable voltage
            self._enter(SWITCH_ON_DISABLED)
        elif not word & 0x04:  # quick stop
            self.quick_stop()
        elif self.state == SWITCH_ON_DISABLED:
            if word & 0x87 == 0x06:
                self._enter(READY)
        elif self.state == QUICK_STOP:
            if word & 0x8F == 0x0F and self._objects.get(0x605A) in (5, 6):
                self._enter(ENABLED)
        elif word & 0x87 == 0x06:  # shutdown
            self._enter(READY)
        elif word & 0x8F == 0x07 and self.state == READY:
            self._enter_later(SWITCHED_ON)
        elif word & 0x8F == 0x07 and self.state == ENABLED:  # disable operation
            self._enter(SWITCHED_ON)
        elif word & 0x8F == 0x0F and self.state == SWITCHED_ON:
            self._enter_later(ENABLED)

    def quick_stop(self):
        if self.state != ENABLED:
            if self.state in (READY, SWITCHED_ON):
                self._enter(SWITCH_ON_DISABLED)
        elif self._objects.get(0x605A, otherwise=2) == 0:
            self._enter(SWITCH_ON_DISABLED)
        else:
            self._enter(QUICK_STOP)

    def trip(self, code):
        if self.state in (FAULT, FAULT_REACTION):
            return
        self._error = code
        self._device.emergency(code)
        braking = self.powered and self._objects.get(0x605E, otherwise=2) != 0
        self._enter(FAULT_REACTION if braking else FAULT)

    def _acknowledge(self):
        self._error = 0
        self._device.emergency(0)
        self._enter(SWITCH_ON_DISABLED)

    def connection_ended(self):
        """0x6007: the master's heartbeat stays away, or NMT takes the connection."""
        option = self._objects.get(0x6007, otherwise=self._options.reaction)
        if not self.powered:
            return
        if option == 1:
            self.trip(0x8100)
        elif option == 2:
            self._enter(SWITCH_ON_DISABLED)
        elif option == 3:
            self.quick_stop()

    # --- motion

    def run(self, dt_s):
        if dt_s <= 0.0:
            return
        self._blink_s += dt_s
        self._settle(dt_s)
        self._move(dt_s)
        self._warn(dt_s)
        self._publish()

    def _settle(self, dt_s):
        if self.state == NOT_READY:
            self._self_test_s -= dt_s
            if self._self_test_s > 0.0:
                return
            self._enter(SWITCH_ON_DISABLED)
            if self._options.boot_fault:
                self.trip(self._options.boot_fault)
        if self._next is not None:
            self._wait_s -= dt_s
            if self._wait_s <= 0.0:
                self._enter(self._next)
        at_rest = abs(self._speed) < 20 and self._demand == 0.0
        if self.state == QUICK_STOP and at_rest and self._objects.get(0x605A, otherwise=2) < 5:
            self._enter(SWITCH_ON_DISABLED)
        if self.state == FAULT_REACTION and at_rest:
            self._enter(FAULT)

    def _ramp(self, target, dt_s, up, down):
        faster = abs(target) > abs(self._demand) and target * self._demand >= 0
        step = dt_s * self._objects.get(up if faster else down, otherwise=24000)
        self._demand += max(-step, min(step, target - self._demand))

    def _move(self, dt_s):
        if self.state == ENABLED and self._objects.get(0x6060) == PROFILE_VELOCITY:
            halted = self._controlword & 0x100
            fastest = self._objects.get(0x607F)
            target = 0 if halted else self._objects.get(0x60FF)
            self._ramp(max(-fastest, min(fastest, target)), dt_s, 0x6083, 0x6084)
        elif self.state == QUICK_STOP and not self._options.no_braking:
            self._ramp(0, dt_s, 0x6085, 0x6084 if self._objects.get(0x605A) in (1, 5) else 0x6085)
        elif self.state == FAULT_REACTION:
            self._ramp(0, dt_s, 0x6085, 0x6084 if self._objects.get(0x605E) == 1 else 0x6085)
        elif not self.powered:
            self._demand = 0.0
        wanted = self._demand / UNITS_PER_MPS * self._options.wheel_gain
        self._wheel.run(dt_s, wanted if self.powered else None)

    def _warn(self, dt_s):
        if self._warnings is None or self.state != ENABLED:
            return
        self._warning_left_s -= dt_s
        if self._warning_left_s <= 0.0:
            self._warning_left_s = self._options.warn_every_s
            self._device.emergency(next(self._warnings))
            self._device.emergency(0)

    def _shown_mode(self):
        if self.state == ENABLED and self._options.enabled_mode is not None:
            return self._options.enabled_mode
        if self._options.late_mode and self.state != ENABLED:
            return 0
        if self._options.blink_mode_s and self._blink_s % self._options.blink_mode_s < BLINK_S:
            return 0
        return self._objects.get(0x6060)

    def _shown_velocity(self):
        hidden = {"true": False, "zero": True, "enabled": self.state != ENABLED}
        return 0 if hidden[self._options.velocity] else self._speed * self._options.velocity_scale

    def _shown_turns(self):
        limit = self._options.freeze_after_turns
        turns = self._wheel.turns * self._options.position_scale
        return turns if limit is None else max(-limit, min(limit, turns))

    def _publish(self):
        put = self._objects.set
        counts = round(self._shown_turns() * GEAR * COUNTS) + self._options.first_count
        target = self._objects.get(0x60FF)
        word = self.state | 0x0210 | self._options.status_bits  # remote; main supply is there
        word |= 0x0400 if abs(self._speed - target) < 50 else 0
        word |= 0x1000 if abs(self._speed) < 20 else 0
        put(0x6041, 0, word)
        put(0x6061, 0, self._shown_mode())
        put(0x6064, 0, (counts + (1 << 31)) % (1 << 32) - (1 << 31))
        put(0x606C, 0, round(self._shown_velocity()))
        put(0x603F, 0, self._error)

    @property
    def wheel_rps(self):
        return self._speed / UNITS_PER_RPS / GEAR  # true speed, whatever it shows

    @property
    def wheel_turns(self):
        return self._wheel.turns
