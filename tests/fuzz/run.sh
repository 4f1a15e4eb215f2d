#!/usr/bin/env bash
# Fuzzes one target for a time, from seeds/NAME on, and says how many inputs were tried; an input that
# breaks it stays in BUILD/fuzz/found.
#   run.sh NAME SECONDS [BUILD [CORPUS]]
# BUILD: that of preset asan. CORPUS: a folder that keeps the inputs with which to go on next time;
# several may use one at the same time.
set -euo pipefail
[ $# -ge 2 ] || { sed -n '2,6s/^# *//p' "$0" >&2; exit 2; }
name=$1 seconds=$2
here=$(cd "$(dirname "$0")" && pwd)
build=$(readlink -f "${3:-$here/../../build/asan}")
work=$(mktemp -d)
trap 'rm -r "$work"' EXIT
corpus=${4:-$work/corpus}
mkdir -p "$corpus" "$build/fuzz/found" "$work/empty"
seeds=$here/seeds/$name
[ -e "$seeds" ] || seeds=$work/empty
# The words of the seeds are what mutations put in.
find -L "$seeds" -type f -exec grep -ahoE '[A-Za-z_][A-Za-z_.]{2,40}' {} + | sort -u |
    sed 's/.*/"&"/' >"$work/words" || true

dictionary=()
[ ! -s "$work/words" ] || dictionary=(-dict="$work/words")
# Another commit explores from another seed; the same commit repeats what it found.
head=$(git -C "$here" rev-parse HEAD 2>/dev/null || echo 0)  # without git: always the same
seed=$((16#0${head:0:7} + 1))
cd "$work" # targets that write do it here
status=0
"$build/fuzz/$name" -seed="$seed" -max_total_time="$seconds" -max_len=4096 -timeout=20 -rss_limit_mb=2048 \
    -malloc_limit_mb=1024 "${dictionary[@]}" -artifact_prefix="$build/fuzz/found/$name-" \
    -print_final_stats=1 -verbosity=1 "$corpus" "$seeds" >"$work/said" 2>&1 || status=$?
inputs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$work/said")
least=5 # so that it is known to work: how many there are says the machine's load as well, and one of "commission" takes 5 s
if [ $status != 0 ] || [ "${inputs:-0}" -lt $least ]; then
    tail -n 60 "$work/said"
    echo "fuzz $name: exit code $status after ${inputs:-0} inputs ($least are the least)"
    exit 1
fi
echo "fuzz $name: $inputs inputs, none that breaks it; $(grep -oE 'cov: [0-9]+' "$work/said" | tail -1 | tr -d ':' | sed 's/cov/edges covered:/')"
