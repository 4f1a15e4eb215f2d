#!/usr/bin/env bash
# All C++ sources are as clang-format would have them.
set -euo pipefail
cd "$(dirname "$0")/../.."
command -v clang-format >/dev/null || { echo "clang-format is missing: apt install clang-format" >&2; exit 1; }
mapfile -t files < <(find common sim controller netem can_bridge onboard doors tools tests bench scenarios examples python -name '*.?pp' | sort)
clang-format --dry-run --Werror "${files[@]}"
echo "${#files[@]} files formatted"
