#!/usr/bin/env -S python3 -B
"""examples/controller.cpp's law, operation by operation; it takes $THINK_S seconds a step."""

import math
import os
import time

import tether


def law(t, pose, path):
    time.sleep(float(os.environ.get("THINK_S", "0")))
    angle = 0.1 * (1e-6 * pose.utime + 2.0)
    u = 20.0 * math.sin(angle)
    w = u * math.cos(angle)
    dx, dy = (u + w) * math.sqrt(0.5) - pose.x_m, (w - u) * math.sqrt(0.5) - pose.y_m
    heading_error = math.remainder(math.atan2(dy, dx) - pose.yaw_rad, 2 * math.pi)
    return 0.495 * math.sqrt(dx * dx + dy * dy), 0.6 * heading_error


tether.main(law)
