#!/usr/bin/env python3
"""Types KEYS into a new interactive zsh that finds its completions in FOLDER, and prints what it shows until
WANTED is in it. Usage: zsh_session.py FOLDER KEYS WANTED"""

import os
import pty
import select
import sys
import time

folder, keys, wanted = sys.argv[1:]
child, terminal = pty.fork()
if child == 0:
    os.chdir(folder)
    os.execvp("zsh", ["zsh", "-f", "-i"])


def shows(text):
    said, end = "", time.monotonic() + 20
    while text not in said:
        if time.monotonic() > end:
            sys.exit(f"not within 20 s: {text!r} in {said!r}")
        if select.select([terminal], [], [], 0.1)[0]:
            said += os.read(terminal, 4096).decode()
    return said


os.write(terminal, f"fpath=({folder} $fpath); autoload -U compinit && compinit -u -d dump; PS1=; echo rea''dy\n".encode())
shows("ready")
os.write(terminal, keys.encode() + b"\t")
print(shows(wanted))
