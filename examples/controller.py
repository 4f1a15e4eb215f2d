#!/usr/bin/env python3
"""A controller of one's own: a proportional law towards where the path is in two seconds.

In real time:      tether live scenarios/paper.toml --set controller.external=true
                   examples/controller.py --scenario scenarios/paper.toml
In simulated time: tether run scenarios/paper.toml --set controller.external=true --processes \\
                       --lcm-url 'udpm://239.255.76.67:7668?ttl=0'
                   examples/controller.py --scenario scenarios/paper.toml --url 'udpm://239.255.76.67:7668?ttl=0'

In simulated time the vehicle waits for the controller, however slow it is, and the run is the same
each time.
"""

import math

import tether


def law(t, pose, path):
    target = path.at(pose.t_s + 2.0)
    dx, dy = target.x_m - pose.x_m, target.y_m - pose.y_m
    heading_error = math.remainder(math.atan2(dy, dx) - pose.yaw_rad, 2 * math.pi)
    return 0.495 * math.hypot(dx, dy), 0.6 * heading_error


tether.main(law)
