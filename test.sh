#!/usr/bin/env bash
# Installs what is missing, builds, and passes all tests: see README.md.
#   ./test.sh          everything
#   ./test.sh quick    while working: builds in release, passes logic and closed loops in virtual time
set -euo pipefail
cd "$(dirname "$0")"

jobs=$(nproc)
case "${1:-}" in
    '') ./setup.sh tests ;;
    quick) ;;
    *) echo "usage: ./test.sh [quick]" >&2; exit 2 ;;
esac
[ -f build/release/build.ninja ] || cmake --preset release
if [ "${1:-}" = quick ]; then
    quiet=()
    [ -t 1 ] || quiet=(-- --quiet)
    cmake --build --preset release --target tether "${quiet[@]}"
    differs=$(tests/docs/reference.py build/release/bin 2>&1) || echo "$differs"  # the sooner known, the better
    cmake --build --preset release --target quick_tests "${quiet[@]}"
    faults=0
    ctest --preset release --build-config Quick --label-regex '^quick$' --parallel "$jobs" --progress || faults=1
    if [ -n "$differs" ]; then
        printf '\n%s\n' "$differs" >&2
        faults=1
    fi
    exit "$faults"
fi
cmake --build --preset release
# Most tests on the wall clock only wait: what computes, the sanitizers' build among it, runs meanwhile.
exec ctest --preset release --parallel "$((3 * jobs))"
