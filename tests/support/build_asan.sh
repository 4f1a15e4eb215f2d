#!/bin/sh
# Builds the preset asan. Quiet unless something is wrong.
#   build_asan.sh             everything
#   build_asan.sh --run TEST  that test program alone, and runs it
set -eu
cd "$(dirname "$0")/../.."
cmake --preset asan -DTETHER_WERROR="$([ -n "${CI:-}" ] && echo ON || echo OFF)" >/dev/null
if [ "${1:-}" = --run ]; then
    cmake --build --preset asan --target "$2" -- --quiet
    exec "build/asan/tests/$2" --gtest_brief=1
fi
exec cmake --build --preset asan -- --quiet
