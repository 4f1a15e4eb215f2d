#!/usr/bin/env bash
# Installs what is missing, builds, and runs the paper's scenario: see README.md.
set -euo pipefail
cd "$(dirname "$0")"

./setup.sh
[ -f build/release/build.ninja ] || cmake --preset release
cmake --build --preset release --target tether

build/release/bin/tether run scenarios/paper.toml --out out/paper
cat <<'TEXT'

Try next:
  PATH=$PWD/build/release/bin:$PATH                          # once in each shell
  tether run scenarios/paper.toml --set channel.prr=0.45     # a bad network
  tether live scenarios/paper.toml                           # real time, over LCM
  tether run scenarios/paper.toml --view                     # in the browser
  tether reproduce --quick                                   # the paper's figures
  tether run scenarios/hil_vcan.toml                         # over a CAN drivetrain
  tether run --keys                                          # all that can be set
TEXT
