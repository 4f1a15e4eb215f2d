#!/usr/bin/env -S python3 -B
"""Makes the documentation's pictures of the page of `tether view`: screenshots, and the animation of two
laws on the same bad network. Needs ImageMagick in addition to the programs of the page's tests. Takes three minutes.

Usage: pictures.py BIN_DIR NPM_DIR OUT_DIR
"""

import pathlib
import subprocess
import sys
import tempfile

from page_support import SOURCE, fail, install, need

BIN, NPM, OUT = (pathlib.Path(argument).resolve() for argument in sys.argv[1:4])
SCENARIO = "scenarios/paper.toml"  # same text as a reader's: it is in the pictures
LOSSY = ["channel.prr=0.45"]
LAWS = {
    "pid": [],
    "predictive": ["controller.law=predictive_consistent", "controller.trigger=timer", "controller.rate_hz=10",
                   "actuator.policy=horizon"],
}
SHOWN_S = 0.08  # each frame of the animation


def run(*command):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True,
                          cwd=SOURCE)
    if done.returncode != 0:
        fail(f"{' '.join(map(str, command))}: {done.stdout}{done.stderr}")


def main():
    need(("convert", "imagemagick"))
    install(NPM)
    OUT.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as work:
        work = pathlib.Path(work)
        for name, settings in LAWS.items():
            sets = [part for setting in LOSSY + settings for part in ("--set", setting)]
            run(BIN / "tether", "run", SCENARIO, *sets, "--out", work / name)
        run("node", NPM / "pictures.mjs", BIN / "tether", SCENARIO, work, OUT)
        frames = work / "frames"
        pairs = sorted(frames.glob("pid-*.png"))
        for left in pairs:
            right = left.with_name(left.name.replace("pid", "predictive"))
            run("convert", left, right, "+append", "+repage", left.with_name(left.name.replace("pid", "both")))
        run("convert", "-delay", round(100 * SHOWN_S), "-loop", "0", *sorted(frames.glob("both-*.png")),
            "-delay", "250", sorted(frames.glob("both-*.png"))[-1], "+dither", "-colors", "40",
            "-fuzz", "1%", "-layers", "Optimize", OUT / "view-two-laws.gif")
        for picture in OUT.glob("view-*.png"):
            run("convert", picture, "+dither", "-colors", "128", "-define", "png:compression-level=9", picture)


main()
