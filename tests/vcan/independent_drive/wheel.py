"""The load of a drive: a wheel that carries its share of a vehicle. Rim speeds in m/s and accelerations
in m/s², positive in the drive's own positive direction."""

import math

RADIUS_M = 0.4
LAG_S = 0.02  # lag of the wheel behind the speed controller's demand
BRAKE_MPS2 = 8.0  # deceleration by a holding brake that closes while the wheel turns


class Wheel:
    """`options`: coasting deceleration (rolling resistance and gear), an acceleration that pushes (a
    slope, a load), what the motor's torque can do, and whether a brake closes without power."""

    def __init__(self, options):
        self._options = options
        self.rim_mps = 0.0
        self.turns = 0.0

    def run(self, dt_s, wanted_mps):
        """`wanted_mps`: what the motor is controlled to; None: it has no power."""
        o = self._options
        before = self.rim_mps
        if wanted_mps is None:
            self._roll(dt_s, o.push_mps2, o.coast_mps2 + (BRAKE_MPS2 if o.holding_brake else 0.0))
        else:
            step = (wanted_mps - self.rim_mps) * (1.0 - math.exp(-dt_s / LAG_S))
            drag = o.coast_mps2 if self.rim_mps > 0 else -o.coast_mps2 if self.rim_mps < 0 else 0.0
            motor = max(-o.torque_mps2, min(o.torque_mps2, step / dt_s - o.push_mps2 + drag))
            self.rim_mps += (motor + o.push_mps2 - drag) * dt_s
        self.turns += (before + self.rim_mps) / 2 * dt_s / (2 * math.pi * RADIUS_M)

    def _roll(self, dt_s, push, drag):
        """Friction only ever brakes: it holds a wheel that is pushed less than it drags."""
        speed = self.rim_mps + push * dt_s
        lost = drag * dt_s
        self.rim_mps = 0.0 if abs(speed) <= lost else speed - math.copysign(lost, speed)
