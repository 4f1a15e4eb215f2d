#!/usr/bin/env bash
# All C++ sources are as clang-format would have them, and no file is longer than 400 lines.
set -euo pipefail
cd "$(dirname "$0")/../.."
command -v clang-format >/dev/null || { echo "clang-format is missing: apt install clang-format" >&2; exit 1; }
mapfile -t files < <(find common sim controller autonomy netem can_bridge localiser link tools tests bench -name '*.?pp' | sort)
clang-format --dry-run --Werror "${files[@]}"
long=$(wc -l "${files[@]}" | awk '$2 != "total" && $1 > 400')
[ -z "$long" ] || { echo "longer than 400 lines:"; echo "$long"; exit 1; }
echo "${#files[@]} files formatted, none longer than 400 lines"
