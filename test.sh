#!/usr/bin/env bash
# Installs what is missing, builds, and passes all tests, with and without sanitizers: see README.md.
set -euo pipefail
cd "$(dirname "$0")"

./setup.sh tests
jobs=$(nproc)
for preset in asan release; do
    [ -f "build/$preset/build.ninja" ] || cmake --preset "$preset"
    cmake --build --preset "$preset"
done
# Under the sanitizers: all but what measures time or the sources, and the long statistics.
ctest --preset asan --parallel "$jobs" --label-exclude 'live|slow|bench|lint'
ctest --preset release --parallel "$jobs"
