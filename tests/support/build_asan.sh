#!/bin/sh
# Builds the preset asan. Quiet unless something is wrong.
set -eu
cd "$(dirname "$0")/../.."
[ -f build/asan/build.ninja ] || cmake --preset asan
exec cmake --build --preset asan -- --quiet
