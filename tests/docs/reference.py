#!/usr/bin/env -S python3 -B
"""The pages of docs/reference that the programs write: all scenario keys, and the helps of all commands."""

import argparse
import difflib
import os
import pathlib
import re
import sys

import helps

FOLDER = pathlib.Path(__file__).resolve().parents[2] / "docs" / "reference"
MADE = "\n<!-- Made by tests/docs/reference.py, from what the programs say. -->\n"
UNITS = {
    "m": "m", "mm": "mm", "s": "s", "ms": "ms", "us": "µs", "hz": "Hz", "Hz": "Hz", "kg": "kg", "rad": "rad",
    "deg": "°", "mps": "m/s", "mps2": "m/s²", "radps": "rad/s", "radps2": "rad/s²", "N": "N", "Nm": "N m",
    "db": "dB", "dB": "dB", "dBm": "dBm", "kbps": "kbit/s", "Mbps": "Mbit/s", "MHz": "MHz", "GHz": "GHz", "bytes": "bytes",
    "min": "min", "percent": "%",
}  # fmt: skip


def unit_of(key):
    if re.search(r"_per_[a-z]+$", key):
        return "1/" + key.rsplit("_per_", 1)[1]
    return UNITS.get(key.rsplit("_", 1)[-1], "") if "_" in key else ""


def cell(text):
    return text.replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")


def keys_page(bin_dir):
    text = (
        f"# Scenario keys\n{MADE}\nEvery key of a scenario file and of `--set KEY=VALUE`, as `tether run --keys` lists "
        "them. `channel.KEY` without a direction sets uplink and downlink; what a key does in its place is in the "
        "pages that [README.md](../../README.md#read-on) lists.\n"
    )
    listed, _, rest = helps.said_by(bin_dir / "tether", "run", "--keys").partition("\nchannel.links.NAME.*")
    section, rows = "", re.findall(r"(?m)^(\S+) = (.*)\n    (.*)$", listed)
    up = {key.replace(".uplink.", ".downlink."): said for key, *said in rows if key.startswith("channel.uplink.")}
    for key, default, meaning in rows:
        if key in up and up[key] == [default, meaning]:
            continue
        name = "channel.uplink" if key.startswith("channel.uplink.") else key.split(".")[0]
        if name != section:
            section = name
            text += f"\n## {section}\n\n"
            if section == "channel.uplink":
                text += "`channel.downlink` has the same keys, with the same defaults"
                own = [k for k, *said in rows if k.startswith("channel.downlink.") and up.get(k) != said]
                text += f", but for {', '.join(f'`{k}`' for k in own)}.\n\n" if own else ".\n\n"
            text += "| key | default | unit | meaning | allowed |\n|-|-|-|-|-|\n"
        said, _, allowed = meaning.rpartition("; ")
        text += f"| `{key}` | `{default}` | {unit_of(key)} | {cell(said)} | {cell(allowed)} |\n"
    return f"{text}\n## Tables\n\n```text\nchannel.links.NAME.*{rest.rstrip()}\n```\n"


def commands_page(bin_dir):
    text = f"# Commands\n{MADE}\nWhat `--help` says, of every command.\n"
    for program in sorted(bin_dir.glob("tether*")):
        if program.suffix or not os.access(program, os.X_OK):
            continue
        for words in helps.all_commands(program):
            said = helps.help_of(program, words).strip()
            text += f"\n##{'#' if words else ''} {' '.join((program.name, *words))}\n\n```text\n{said}\n```\n"
    return text


def programs_not_built(bin_dir):
    """Programs that commands.md documents and the folder lacks. Without them the page would lose their sections."""
    page = FOLDER / "commands.md"
    documented = re.findall(r"(?m)^## (tether\S*)$", page.read_text()) if page.exists() else []
    return [name for name in documented if not os.access(bin_dir / name, os.X_OK)]


def names_missing(bin_dir, missing):
    return (
        f"not built: {', '.join(missing)}, which docs/reference/commands.md documents. "
        f"Run: cmake --build {bin_dir.parent} --target {' '.join(missing)}"
    )


def pages(bin_dir):
    return {FOLDER / "keys.md": keys_page(bin_dir), FOLDER / "commands.md": commands_page(bin_dir)}


def out_of_date(bin_dir):
    if missing := programs_not_built(bin_dir):
        yield names_missing(bin_dir, missing)
        return
    for file, text in pages(bin_dir).items():
        page = file.read_text() if file.exists() else ""
        if page != text:
            lines = difflib.unified_diff(page.splitlines(), text.splitlines(), n=0, lineterm="")
            changed = [line for line in lines if line[:1] in "+-"][2:]
            told = f"docs/reference/{file.name} is not what the programs say (tests/docs/reference.py {bin_dir} --write):"
            yield "\n    ".join((told, *changed[:6]))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bin_dir", type=pathlib.Path, help="folder of the programs: build/release/bin")
    way = parser.add_mutually_exclusive_group()
    way.add_argument("--write", action="store_true", help="write the pages")
    way.add_argument("--check", action="store_true", help="say which are out of date (the default); exit code 1 if any is")
    given = parser.parse_args()
    bin_dir = given.bin_dir.resolve()
    if given.write:
        if missing := programs_not_built(bin_dir):
            print(f"Nothing written: {names_missing(bin_dir, missing)}", file=sys.stderr)
            return 1
        FOLDER.mkdir(exist_ok=True)
        for file, text in pages(bin_dir).items():
            file.write_text(text)
        return 0
    faults = list(out_of_date(bin_dir))
    if faults:
        print("\n".join(faults))
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
