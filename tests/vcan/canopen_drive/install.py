#!/usr/bin/env -S python3 -B
"""Installs the packages of package-lock.json, and drive.mjs beside them. Usage: install.py FOLDER"""

import pathlib
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "support"))
from npm_packages import install  # noqa: E402

install(HERE, pathlib.Path(sys.argv[1]).resolve())
