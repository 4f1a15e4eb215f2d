#!/usr/bin/env python3
"""The report of sweeps opens in a browser without a network and shows its figures, tables and
verdicts.

Usage: report_page_test.py BIN_DIR
"""

import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

SOURCE = pathlib.Path(__file__).resolve().parents[2]
# Short versions of the paper's experiments, under their names: the claims are judged.
SWEEPS = {
    "f2_prr": """
seeds = 12
[grid]
channel.prr = [0.1, 0.3, 0.85, 1.0]
[figure]
kind = "curve"
x = "channel.prr"
title = "Error & <PRR>"
""",
    "f4_tau": """
seeds = 6
[grid]
controller.tau_s = [1.0, 2.0, 3.0]
channel.prr = [0.45, 1.0]
[figure]
kind = "heatmap"
x = "channel.prr"
y = "controller.tau_s"
""",
}
BLUE, RED = "#0072B2", "#D40000"  # of a curve, and of the box around the best τ


def check(condition, what):
    if not condition:
        sys.exit(f"report_page_test: {what}")


def run(*command):
    result = subprocess.run(command, capture_output=True, text=True, timeout=200)
    check(result.returncode == 0, f"{' '.join(map(str, command))}: {result.stderr}")
    return result.stdout


def pixels(picture, colour):
    """How many have about this colour."""
    histogram = run(
        "convert", str(picture), "-fuzz", "8%", "-fill", "black", "+opaque", colour,
        "-fill", "white", "-opaque", colour, "-format", "%[fx:int(mean*w*h+0.5)]", "info:",
    )
    return int(float(histogram))


def main():
    tether = str(pathlib.Path(sys.argv[1]).resolve() / "tether")
    for program, package in (("chromium", "chromium"), ("convert", "imagemagick")):
        check(shutil.which(program), f"{program} is missing: apt-get install {package}")
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for sweep, text in SWEEPS.items():
            experiment = folder / f"{sweep}.toml"
            scenario = f'scenario = "{SOURCE}/scenarios/paper.toml"\n'
            plant = '[set]\nvehicle.plant = "kinematic"\n'
            head, grid = text.split("[grid]")
            experiment.write_text(scenario + head + plant + "[grid]" + grid)
            own = folder / "out" / sweep
            run(tether, "sweep", str(experiment), "--out", str(own), "--quick", "--report")
            check((own / f"{sweep}.png").exists(), "sweep --report drew nothing")
        said = run(tether, "report", str(folder / "out"))
        check("at PRR 1 the best τ is 2 s" in said, f"no claim in: {said}")
        page = folder / "out" / "report.html"
        text = page.read_text()
        check("http" not in text.replace("http://www.w3.org", ""), "the page refers to the net")

        browser = ["chromium", "--headless=new", "--no-sandbox", "--disable-gpu",
                   "--hide-scrollbars", f"--user-data-dir={folder}/profile"]
        dom = run(*browser, "--dump-dom", page.as_uri())
        for part in (
            "Error &amp; &lt;PRR&gt;", 'class="verdict reproduced">reproduced<', "f2_prr: 48 runs, seeds 1 to 12",
            "plant kinematic", "All numbers", 'id="claims"',
        ):
            check(part in dom, f"the page does not have: {part}")
        picture = folder / "page.png"
        run(*browser, "--window-size=1000,3000", f"--screenshot={picture}", page.as_uri())
        size = run("identify", "-format", "%wx%h", str(picture))
        check(size == "1000x3000", f"the picture is {size}")
        blue, red = pixels(picture, BLUE), pixels(picture, RED)
        print(f"{blue} blue pixels, {red} red ones")
        check(blue > 500, f"only {blue} pixels of the curve's blue: is the figure shown?")
        check(red > 500, f"only {red} pixels of the boxes' red: is the heat map shown?")
        # Two sweeps of one experiment go by their folders and are no answer to a claim.
        shutil.copytree(folder / "out" / "f2_prr", folder / "out" / "again")
        said = run(tether, "report", str(folder / "out"))
        check("at PRR 1, τ = 2 s" not in said, f"a claim by one of two sweeps: {said}")
        check("at PRR 1 the best τ is 2 s" in said, f"no claim of the other sweep: {said}")
        for stem in ("again", "f2_prr", "f4_tau"):
            check((folder / "out" / f"{stem}.svg").exists(), f"no {stem}.svg")
        if keep := os.environ.get("TETHER_PICTURES"):
            shutil.copy(picture, pathlib.Path(keep) / "report.png")


if __name__ == "__main__":
    main()
