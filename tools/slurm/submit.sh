#!/usr/bin/env bash
# Computes a sweep on a Slurm cluster: a job array of SHARDS tasks, each of which makes one shard,
# and a job that merges them when all have ended.
#
#   tools/slurm/submit.sh EXPERIMENT.toml OUT SHARDS [options of sbatch for both]
#
# OUT must be a folder that all nodes see. TETHER names the program where the nodes find it
# [build/release/bin/tether of this project]. A task that is requeued goes on where it stood; if
# tasks were lost, the same command again makes what is missing.
set -euo pipefail

if [ $# -lt 3 ]; then
    sed -n 's/^# \{0,1\}//;3,8p' "$0" >&2
    exit 2
fi
experiment=$(realpath -- "$1")
out=$(realpath -m -- "$2")
shards=$3
shift 3
here=$(dirname -- "$(realpath -- "$0")")
export TETHER=${TETHER:-$(realpath -m -- "$here/../../build/release/bin/tether")}
[ -x "$TETHER" ] || { echo "submit.sh: there is no program $TETHER: build it, or set TETHER" >&2; exit 2; }
case $shards in '' | *[!0-9]* | 0) echo "submit.sh: SHARDS must be a number from 1 on, not \"$shards\"" >&2; exit 2 ;; esac
[ ! -e "$out/runs.sqlite" ] || { echo "submit.sh: $out/runs.sqlite is there already" >&2; exit 2; }
"$TETHER" sweep "$experiment" --dry-run --shard "1/$shards"

mkdir -p -- "$out"
array=$(sbatch --parsable --array="1-$shards" --output="$out/shard-%a.log" --open-mode=append \
    "$@" "$here/shard.sbatch" "$experiment" "$out" "$shards")
echo "shards: job $array"
merge=$(sbatch --parsable --dependency="afterok:$array" --kill-on-invalid-dep=yes \
    "$@" --output="$out/merge.log" "$here/merge.sbatch" "$out")
echo "merge:  job $merge, result: $out/runs.sqlite"
