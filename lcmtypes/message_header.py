#!/usr/bin/env python3
"""Writes the C++ headers of one message type: message_header.py LCM_GEN tether_pose.lcm OUT

OUT/lcm-gen/tether/pose_t.hpp is LCM's class. OUT/tether/pose_t.hpp, which the project includes,
adds visit_fields(message, visit): it calls visit("x_m", message.x_m) for each field, in the order of
the file, and visit("v_mps", message.v_mps, message.count) for an array of variable length.

The layout is what `lcm-gen --debug` prints: LCM's own reading of the file. This script knows no
grammar, only which of LCM's types our other code can handle, and refuses the rest.
"""

import pathlib
import re
import subprocess
import sys

# Not int8_t: LCM's boolean is the same type in C++.
TYPES = {"boolean", "byte", "int16_t", "int32_t", "int64_t", "float", "double", "string"}
FIELD = re.compile(r"\t(\S+) +(\w+)(.*)")
DIMENSION = re.compile(r" \[ \((const|var)\) (\w+) \]")

HEADER = """\
// Written by lcmtypes/message_header.py from {file}.
#pragma once

#include <lcm-gen/tether/{type}.hpp>

namespace tether {{

template <class Visitor>
void visit_fields({type}& message, Visitor&& visit) {{
{visits}}}

}}  // namespace tether
"""


def refuse(file, pattern, why):
    """Ends the program with an error that names the first line that fits the pattern."""
    lines = enumerate(file.read_text().splitlines(), start=1)
    at = next((f":{number}" for number, line in lines if re.search(pattern, line)), "")
    sys.exit(f"{file}{at}: {why}")


def visit(file, line):
    """The C++ statement for a field's line of `lcm-gen --debug`."""
    kind, name, dimensions = FIELD.fullmatch(line).groups()
    declaration = rf"^[^/]*\b{kind.split('.')[-1]}\b[^/]*\b{name}\b"
    if kind not in TYPES:
        refuse(file, declaration, f"the type of {name} is not one of {', '.join(sorted(TYPES))}")
    count = DIMENSION.fullmatch(dimensions)
    if dimensions and not count:
        refuse(file, declaration, f"{name} has more than one dimension")
    size = f", message.{count[2]}" if count and count[1] == "var" else ""
    return f'  visit("{name}", message.{name}{size});\n'


def main(lcm_gen, file, out):
    done = subprocess.run([lcm_gen, "--debug", "--cpp", "--cpp-std=c++11", "--cpp-hpath",
                           out / "lcm-gen", file], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(re.sub(r" : (\d+)\n", r":\1:\n", done.stderr + done.stdout))
    struct = file.stem.removeprefix("tether_") + "_t"
    first, *fields = done.stdout.splitlines() or [""]
    if not first.startswith(f"struct tether.{struct} ") or not all(map(FIELD.fullmatch, fields)):
        refuse(file, rf"\b(enum|struct)\s+(?!{struct}\b)",
               f"a file holds one struct and nothing else, here tether.{struct}")
    visits = "".join(visit(file, line) for line in fields)
    header = out / "tether" / f"{struct}.hpp"
    header.parent.mkdir(parents=True, exist_ok=True)
    header.write_text(HEADER.format(file=file.name, type=struct, visits=visits))


if __name__ == "__main__":
    main(sys.argv[1], pathlib.Path(sys.argv[2]), pathlib.Path(sys.argv[3]))
