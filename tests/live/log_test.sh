#!/bin/sh
# `tether log` on a log without live traffic: tables, bad usage, full disks.
# Usage: log_test.sh BIN_DIR
set -eu
# shellcheck source=tests/live/live_helpers.sh
. "$(dirname "$0")/live_helpers.sh"
tether=$bin/tether

printf '[run]\nduration_s = 5.0\n[sensor]\nrate_hz = 20.0\n' >scenario.toml
"$tether" run scenario.toml --out run >run.txt
log=run/run.lcmlog

# expect CODE TEXT COMMAND...: the exit code, and what it says on either output.
expect() {
    code=$1
    text=$2
    shift 2
    status=0
    "$@" >said.txt 2>&1 || status=$?
    [ "$status" = "$code" ] || fail "$*: exit code $status, not $code: $(cat said.txt)"
    grep -Fq -- "$text" said.txt || fail "$*: no \"$text\" in: $(cat said.txt)"
}

expect 0 'ground_truth_t' "$tether" log info "$log"
expect 0 'counters_t' "$tether" log info "$log"
expect 2 'is not an LCM event log' "$tether" log info scenario.toml
expect 2 'cannot read the log "nowhere"' "$tether" log info nowhere
expect 2 'is a directory' "$tether" log info run
expect 2 'no channel "AGV/POS"; it has: AGV/CMD_VEL, AGV/POSE, ' "$tether" log csv "$log" AGV/POS
expect 2 'is the log itself' "$tether" log csv "$log" AGV/POSE --out "run/../$log"
expect 1 'cannot write nowhere/x.csv' "$tether" log csv "$log" AGV/POSE --out nowhere/x.csv
expect 1 'No space left on device' "$tether" log csv "$log" SIM/TRUTH --out /dev/full
expect 1 'No space left on device' sh -c "'$tether' log csv '$log' AGV/POSE >/dev/full"
expect 1 'No space left on device' sh -c "'$tether' log info '$log' >/dev/full"
: >empty.lcmlog
expect 0 '0 bytes, 0 events' "$tether" log info empty.lcmlog

# Both kinds of MCAP have names of their own.
"$tether" log mcap "$log" >/dev/null 2>&1
cp run/run.mcap json.mcap
expect 0 'run/run.ros2.mcap: ' "$tether" log mcap "$log" --ros2
cmp json.mcap run/run.mcap || fail "the bag took the place of the JSON"

# Every table: a name for each column, in each row, and time that never goes back.
for channel in AGV/POSE AGV/CMD_VEL CTRL/REPORT SIM/TRUTH SIM/CLOCK NET/UPLINK NET/COUNTERS; do
    "$tether" log csv "$log" "$channel" --out table.csv
    awk -F, -v channel="$channel" '
        NR == 1 { columns = NF; if ($1 != "t_s" || $2 != "utime" || $3 != "seq") exit 1; next }
        NF != columns || $1 < last { print channel ": line " NR ": " $0; exit 1 }
        { last = $1 }
        END { if (NR < 3) { print channel ": " NR " lines"; exit 1 } }' table.csv ||
        fail "table of $channel"
done

# The log and the trajectory are two records of one run: the same poses, digit by digit.
"$tether" log csv "$log" SIM/TRUTH | tail -n +2 | cut -d, -f1,4-6 >log.poses
tail -n +2 run/trajectory.csv | cut -d, -f1-4 >trajectory.poses
cmp log.poses trajectory.poses || fail "run.lcmlog and trajectory.csv differ"
echo "passed: $(wc -l <log.poses) rows of truth as in the trajectory; bad usage, full disks refused"
