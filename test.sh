#!/usr/bin/env bash
# Builds and tests: see README.md.
#   ./test.sh          to trust a build: logic, closed loops, real processes, CAN, packages, documents, and a
#                      sample of each kind that takes long
#   ./test.sh all      everything, as CI does: sanitizers, fuzzing, clang-tidy, mutation and long statistics, too
#   ./test.sh quick    while working: logic and closed loops in virtual time; installs nothing
set -euo pipefail
cd "$(dirname "$0")"

jobs=$(nproc)
tier=${1:-person}
case "$tier" in
    person | all) ./setup.sh tests ;;
    quick) ;;
    *) echo "usage: ./test.sh [all | quick]" >&2; exit 2 ;;
esac
if [ "$tier" != quick ]; then  # a warning stops CI alone
    cmake --preset release -DTETHER_WERROR="$([ -n "${CI:-}" ] && echo ON || echo OFF)"
elif [ ! -f build/release/build.ninja ]; then
    cmake --preset release
fi
if [ "$tier" = quick ]; then
    quiet=()
    [ -t 1 ] || quiet=(-- --quiet)
    cmake --build --preset release --target tether "${quiet[@]}"
    differs=$(tests/docs/reference.py build/release/bin 2>&1) || echo "$differs"  # the sooner known, the better
    cmake --build --preset release --target quick_tests "${quiet[@]}"
    faults=0
    ctest --preset release --label-regex '^quick$' --parallel "$jobs" --progress || faults=1
    if [ -n "$differs" ]; then
        printf '\n%s\n' "$differs" >&2
        faults=1
    fi
    exit "$faults"
fi
cmake --build --preset release
# Most tests on the wall clock only wait: what computes, the sanitizers' build among it, runs meanwhile.
if [ "$tier" = all ]; then
    exec ctest --preset release --parallel "$((3 * jobs))"
fi
exec ctest --preset release --build-config Sample --label-exclude '^(slow|asan|mutation|tidy|kernel|bench|ns3)$' \
    --parallel "$((3 * jobs))"
