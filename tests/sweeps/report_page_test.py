#!/usr/bin/env python3
"""The report of sweeps opens in a browser without a network and shows its figures, tables and
verdicts.

Usage: report_page_test.py BIN_DIR
"""

import html
import json
import os
import pathlib
import re
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
# Labels that end or swallow a script, an attribute or the page.
HOSTILE = (
    "<!--<script>", "</script><script>document.title='taken'</script>", "]]>\"'&<b>", "</title><h1>",
    "<img src=x onerror=document.title='taken'>",
)
BLUE, RED = "#0072B2", "#D40000"  # colours of a curve, and of the box around the best τ


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


# Opens the first chart and clicks at its series' second point, as a reader does.
CLICK = """<script>{
  const chart = Chart.getChart(document.querySelector("canvas"));
  const { x, y } = chart.getDatasetMeta(0).data[1];
  const { left, top } = chart.canvas.getBoundingClientRect();
  const at = { clientX: left + x, clientY: top + y, bubbles: true };
  chart.canvas.dispatchEvent(new MouseEvent("click", at));
}</script></body>"""


def explores(tether, browser, text, folder):
    """A click at a point shows its runs, and the command that it shows makes one of them again."""
    page = folder / "clicked.html"
    opened = text.replace('<details class="chart">', '<details class="chart" open>')
    page.write_text(opened.replace("</body>", CLICK))
    dom = run(*browser, "--window-size=1000,3000", "--virtual-time-budget=2000", "--dump-dom", page.as_uri())
    shown = re.search(r'<div class="runs"><p>(.*?)<select>(.*?)</select>.*?<pre>(.*?)</pre>', dom, re.DOTALL)
    check(shown, "a click at a point shows nothing")
    title, runs, command = (html.unescape(part) for part in shown.groups())
    check("PRR 0.3" in title and "n = 12" in title, f"not the point that was clicked: {title}")
    seed, value = re.match(r'<option value="(\d+)">seed \d+: ([\d.]+)<', runs).groups()
    check(len(re.findall("<option", runs)) == 12, f"not all runs: {runs}")
    print(f"{title}\n{command}")
    subprocess.run(command.split("\n")[0].replace("tether", tether, 1), shell=True, check=True, cwd=folder)
    again = run(tether, "run", str(folder / "again.toml"), "--json")
    epsilon_m = json.loads(again)["epsilon_m"]
    check(float(f"{epsilon_m:.4g}") == float(value), f"seed {seed} again: {epsilon_m}, not {value}")


def shows_hostile_labels(tether, browser, folder):
    """A report whose labels, title and keys try to be HTML and scripts is shown as text."""
    arms = "".join(f"[axis.label.{json.dumps(text)}]\nchannel.prr = {0.5 + 0.1 * i}\n" for i, text in enumerate(HOSTILE))
    experiment = folder / "hostile.toml"
    experiment.write_text(f"""scenario = "{SOURCE}/scenarios/paper.toml"
seeds = 2
[set]
vehicle.plant = "kinematic"
run.duration_s = 5
[grid]
controller.tau_s = [1.0, 2.0]
{arms}[figure]
kind = "comparison"
x = "controller.tau_s"
y = "label"
title = {json.dumps(HOSTILE[0] + HOSTILE[1])}
""")
    own = folder / "hostile"
    run(tether, "sweep", str(experiment), "--out", str(own), "--report")
    page = own / "report.html"
    text = page.read_text()
    data = re.findall(r'<script type="application/json">(.*?)</script>', text, re.DOTALL)
    check(data and "<" not in data[0], "embedded JSON has a <")
    shown = json.dumps(json.loads(data[0]), ensure_ascii=False)
    check(all(json.dumps(label, ensure_ascii=False)[1:-1] in shown for label in HOSTILE), "a label is not in the data")
    probe = own / "probe.html"
    probe.write_text(text.replace('<details class="chart">', '<details class="chart" open>').replace("</body>", """<script>document.body.dataset.charts =
  [...document.querySelectorAll("canvas")].filter((c) => Chart.getChart(c)).length;</script></body>"""))
    dom = run(*browser, "--virtual-time-budget=2000", "--dump-dom", probe.as_uri())
    check(re.search(r'data-charts="1"', dom), "the chart is not drawn")
    check("<title>taken</title>" not in dom, "a label ran as a script")
    check("All numbers" in dom, "a label swallowed the page")
    print(f"{len(HOSTILE)} hostile labels shown as text")


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
        check(not re.search(r"""(src|href)=["']?http|url\(["']?http|fetch\(|XMLHttp|WebSocket""", text),
              "the page refers to the net")

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
        explores(tether, browser, text, folder)
        shows_hostile_labels(tether, browser, folder)
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
