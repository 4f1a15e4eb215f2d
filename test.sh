#!/usr/bin/env bash
# Installs what is missing, builds, and passes all tests: see README.md.
set -euo pipefail
cd "$(dirname "$0")"

./setup.sh tests
jobs=$(nproc)
for preset in asan release; do
    [ -f "build/$preset/build.ninja" ] || cmake --preset "$preset"
    cmake --build --preset "$preset"
done
# Under the sanitizers, by Clang: all logic, then what meets real sockets and hostile traffic.
ctest --preset asan --parallel "$jobs" --label-exclude 'live|slow|bench|lint'
ctest --preset asan --tests-regex '^(lcm_bus_test|real_time_loop_test|live_hostile_test|log_test)$'
ctest --preset release --parallel "$jobs"
