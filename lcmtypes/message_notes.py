#!/usr/bin/env python3
"""Writes what the comments of .lcm files say as rows of C++: message_notes.py OUT tether_pose.lcm...

OUT/tether/message_notes.inc has TETHER_MESSAGE("pose_t", "what the struct is"),
TETHER_FIELD("pose_t", "x_m", "what the field is") and TETHER_CONSTANT("plan_t", "NONE", -1, "what it
means"), in the order of the files.

A comment behind a field or constant belongs to it, and so do lines of comment below that begin
further right than it; a comment of the same indentation belongs to what comes next.
"""

import json
import pathlib
import re
import sys

COMMENT = re.compile(r"( *)// ?(.*)")
STRUCT = re.compile(r"struct (\w+)")
CONSTANT = re.compile(r"( *)const \w+ (\w+) *= *(-?\w+);(?: *// ?(.*))?")
FIELD = re.compile(r"( *)[\w.]+ (\w+)(?:\[\w+\])*;(?: *// ?(.*))?")


def rows(text):
    """Lists [macro, struct, its other arguments..., words of the comment]."""
    found, before, struct = [], [], None
    for line in text.splitlines():
        if comment := COMMENT.fullmatch(line):
            indent, words = comment.groups()
            if found and struct and not before and len(indent) > 2:
                found[-1][-1].append(words)
            else:
                before.append(words)
            continue
        if match := STRUCT.match(line):
            struct = match[1]
            found.append(["TETHER_MESSAGE", json.dumps(struct), before])
        elif match := CONSTANT.fullmatch(line):
            found.append(["TETHER_CONSTANT", json.dumps(struct), json.dumps(match[2]), match[3],
                          before + [match[4] or ""]])
        elif struct and (match := FIELD.fullmatch(line)):
            found.append(["TETHER_FIELD", json.dumps(struct), json.dumps(match[2]),
                          before + [match[3] or ""]])
        before = []
    return found


def main(out, *files):
    lines = []
    for file in files:
        for macro, *arguments, words in rows(pathlib.Path(file).read_text()):
            words = json.dumps(" ".join(" ".join(words).split()))
            lines.append(f"{macro}({', '.join([*arguments, words])})\n")
    notes = pathlib.Path(out) / "tether" / "message_notes.inc"
    notes.parent.mkdir(parents=True, exist_ok=True)
    notes.write_text("// Written by lcmtypes/message_notes.py.\n" + "".join(lines))


if __name__ == "__main__":
    main(*sys.argv[1:])
