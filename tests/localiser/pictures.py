#!/usr/bin/env python3
"""Pictures of docs/explanation/localisation.md: a scan in the hall on the map, error ellipses against the truth, and the
degenerate corridor. Needs gnuplot. Usage: pictures.py BIN_DIR OUT_DIR"""

import bisect
import csv
import math
import pathlib
import subprocess
import sys
import tempfile
import tomllib

HERE = pathlib.Path(__file__).resolve().parents[2]
FACTORY = HERE / "scenarios" / "factory.toml"

CORRIDOR = """
[run]
duration_s = 20
[world]
half_extent_m = 60.0
[[world.obstacle]]
kind = "wall"
x_m = 0.0
y_m = 1.6
length_m = 100.0
[[world.obstacle]]
kind = "wall"
x_m = 0.0
y_m = -1.6
length_m = 100.0
[[world.obstacle]]
kind = "box"
x_m = 12.0
y_m = 1.3
length_m = 1.0
width_m = 0.4
[vehicle]
plant = "kinematic"
start_x_m = -16.0
chassis_length_m = 0.9
chassis_width_m = 0.58
track_m = 0.45
wheel_width_m = 0.05
radius_error = 0.005
[path]
kind = "line"
start_x_m = -16.0
length_m = 30.0
speed_mps = 1.5
[sensor]
odometry_rate_hz = 50
[lidar]
model = "custom"
range_max_m = 12.0
[controller]
law = "tracking"
[localiser]
place = "vehicle"
"""


def run(binaries, scenario, overrides, folder):
    """The columns of truth, localisations and scans, as lists of rows."""
    sets = [f"--set={o}" for o in overrides]
    subprocess.run([binaries / "tether", "run", scenario, *sets, "--out", folder], check=True,
                   stdout=subprocess.DEVNULL)
    out = {}
    for channel in ("SIM/TRUTH", "AGV/LOCALISATION", "AGV/SCAN"):
        text = subprocess.run([binaries / "tether", "log", "csv", folder / "run.lcmlog", channel], check=True,
                              capture_output=True, text=True).stdout
        out[channel] = list(csv.DictReader(text.splitlines()))
    return out


def outlines(scenario):
    """Closed lines around what stands in the map, at the scanner's height: of racks their posts."""
    world = tomllib.loads(scenario)["world"]
    half = world["half_extent_m"]
    lines = [[(-half, -half), (half, -half), (half, half), (-half, half), (-half, -half)]]

    def box(x, y, length, width, yaw):
        c, s = math.cos(yaw), math.sin(yaw)
        corners = [(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1)]
        return [(x + c * a * length / 2 - s * b * width / 2, y + s * a * length / 2 + c * b * width / 2)
                for a, b in corners]

    for o in world.get("obstacle", []):
        if o.get("to") or not o.get("mapped", True):
            continue
        x, y, yaw = o.get("x_m", 0.0), o.get("y_m", 0.0), math.radians(o.get("yaw_deg", 0.0))
        length, width = o.get("length_m", 1.0), o.get("width_m", 0.2 if o["kind"] == "wall" else 1.0)
        if o["kind"] == "cylinder":
            r = o.get("radius_m", 0.25)
            lines.append([(x + r * math.cos(a / 10), y + r * math.sin(a / 10)) for a in range(64)])
        elif o["kind"] == "rack":
            bays = max(1, math.ceil((length - 0.1) / 2.8 - 1e-9))
            for i in range(bays + 1):
                along = (length - 0.1) * (i / bays - 0.5)
                for side in (-1, 1):
                    across = side * (width - 0.1) / 2
                    c, s = math.cos(yaw), math.sin(yaw)
                    lines.append(box(x + c * along - s * across, y + s * along + c * across, 0.1, 0.1, yaw))
        else:
            lines.append(box(x, y, length, width, yaw))
    return lines


def number(row, name):
    return float(row[name])


def ellipse(row, sigmas, grow=1.0, about=None):
    """Ellipse of a localisation's covariance, around it or around `about`."""
    xx, xy, yy = (number(row, f"cov_{n}_m2") for n in ("x_x", "x_y", "y_y"))
    middle, half = (xx + yy) / 2, math.hypot((xx - yy) / 2, xy)
    direction = 0.5 * math.atan2(2 * xy, xx - yy)
    a, b = (sigmas * grow * math.sqrt(max(v, 0.0)) for v in (middle + half, middle - half))
    x, y = about or (number(row, "x_m"), number(row, "y_m"))
    c, s = math.cos(direction), math.sin(direction)
    return [(x + c * a * math.cos(t / 20) - s * b * math.sin(t / 20),
             y + s * a * math.cos(t / 20) + c * b * math.sin(t / 20)) for t in range(127)]


def beams(scan, pose):
    """Where they end if the vehicle is there; a scan's distortion by motion is left in."""
    mount = [number(scan, f"mount_{n}") for n in ("x_m", "y_m", "yaw_rad")]
    x, y, yaw = pose
    c, s = math.cos(yaw), math.sin(yaw)
    ends = []
    for i, text in enumerate(scan["range_m"].split(";")):
        r = float(text)
        if r > 0:
            a = yaw + mount[2] + number(scan, "angle_min_rad") + i * number(scan, "angle_increment_rad")
            ends.append((x + c * mount[0] - s * mount[1] + r * math.cos(a),
                         y + s * mount[0] + c * mount[1] + r * math.sin(a)))
    return ends


def nearest(rows, t):
    return min(rows, key=lambda row: abs(int(row["utime"]) * 1e-6 - t))


def plot(folder, name, size, commands, blocks):
    """`blocks`: name of a gnuplot data block, and its lines of points."""
    data = ""
    for block, lines in blocks.items():
        points = "\n\n".join("\n".join(f"{x:.5f} {y:.5f}" for x, y in line) for line in lines)
        data += f"${block} << EOD\n{points}\nEOD\n"
    script = (f"set terminal pngcairo size {size[0]},{size[1]} font 'sans,11'\nset output '{folder / (name + '.png')}'\n"
              "set grid lc rgb '#e0e0e0'\nset key outside top center horizontal\n" + data + commands)
    subprocess.run(["gnuplot"], input=script, text=True, check=True)


def scan_on_the_map(binaries, out, work):
    rows = run(binaries, FACTORY, ["vehicle.plant=kinematic", "run.duration_s=40"], work / "factory")
    found = nearest(rows["AGV/LOCALISATION"], 24.0)
    scan = next(s for s in rows["AGV/SCAN"] if s["seq"] == found["scan_seq"])
    pose = [number(found, n) for n in ("x_m", "y_m", "yaw_rad")]
    ends = beams(scan, pose)
    drawn = outlines(FACTORY.read_text())
    hits = {"map": drawn, "beams": [[(e)] for e in ends], "vehicle": [[tuple(pose[:2])]]}
    plot(out, "localisation-scan", (900, 640),
         "set size ratio -1\nset xrange [-31:31]\nset yrange [-21:21]\nset xlabel 'x [m]'\nset ylabel 'y [m]'\n"
         "plot $map with lines lc rgb '#666666' title 'map', "
         "$beams with points pt 7 ps 0.35 lc rgb '#d62728' title 'one scan', "
         "$vehicle with points pt 9 ps 1.6 lc rgb '#1f77b4' title 'vehicle'\n", hits)
    errors_and_ellipses(rows, out)


def errors(rows):
    """Each localisation, and its error along x and y in mm."""
    truth = rows["SIM/TRUTH"]
    times = [int(row["utime"]) * 1e-6 for row in truth]
    for found in rows["AGV/LOCALISATION"]:
        t = int(found["utime"]) * 1e-6
        i = bisect.bisect_left(times, t)
        if 0 < i < len(times):
            share = (t - times[i - 1]) / (times[i] - times[i - 1])
            at = [number(truth[i - 1], n) + share * (number(truth[i], n) - number(truth[i - 1], n))
                  for n in ("x_m", "y_m")]
            yield found, (1e3 * (number(found, "x_m") - at[0]), 1e3 * (number(found, "y_m") - at[1]))


def errors_and_ellipses(rows, out):
    """Samples of one scan in 30: the error, and the ellipse that 95 % of errors should be within."""
    some = list(errors(rows))[10::30]
    blocks = {"errors": [[error] for _, error in some],
              "ellipses": [ellipse(found, math.sqrt(5.991), 1e3, (0.0, 0.0)) for found, _ in some]}
    plot(out, "localisation-ellipses", (620, 360),
         "set size ratio -1\nset xlabel 'error along x [mm]'\nset ylabel 'error along y [mm]'\n"
         "plot $ellipses with lines lc rgb '#9ecae1' title 'covariance, 95 %', "
         "$errors with points pt 7 ps 0.7 lc rgb '#d62728' title 'found minus truth'\n", blocks)


def corridor(binaries, out, work):
    """A vehicle whose wheels are 0.5 % larger than it believes, in a corridor of 3 m with one box at 12 m,
    which its scanner sees from 12 m away."""
    scenario = work / "corridor.toml"
    scenario.write_text(CORRIDOR)
    rows = run(binaries, scenario, [], work / "corridor")
    blocks = {"along": [[]], "across": [[]], "error": [[]]}
    for found, error in errors(rows):
        x = number(found, "x_m")
        blocks["along"][0].append((x, 1e3 * math.sqrt(number(found, "cov_x_x_m2"))))
        blocks["across"][0].append((x, 1e3 * math.sqrt(number(found, "cov_y_y_m2"))))
        blocks["error"][0].append((x, max(abs(error[0]), 1e-2)))
    plot(out, "localisation-corridor", (760, 400),
         "set logscale y\nset xrange [-17:14]\nset xlabel 'way along the corridor [m]'\nset ylabel '[mm]'\n"
         "plot $along with lines lw 2 lc rgb '#d62728' title 'standard deviation along', "
         "$across with lines lw 2 lc rgb '#1f77b4' title 'across', "
         "$error with points pt 7 ps 0.4 lc rgb '#333333' title 'error along'\n", blocks)


def main():
    binaries, out = (pathlib.Path(a).resolve() for a in sys.argv[1:3])
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as work:
        scan_on_the_map(binaries, out, pathlib.Path(work))
        corridor(binaries, out, pathlib.Path(work))


if __name__ == "__main__":
    main()
