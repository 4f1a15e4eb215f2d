#!/bin/sh
# `tether echo` on live traffic: decodes, counts, measures rates and losses; survives garbage; ends
# orderly; refuses nonsense with exit code 2.
# Usage: echo_test.sh BIN_DIR
set -eu
# shellcheck source=tests/live/live_helpers.sh
. "$(dirname "$0")/live_helpers.sh"
need bash bash # for /dev/udp
tether=$bin/tether

cat >scenario.toml <<'EOF'
[run]
duration_s = 600.0
[sensor]
rate_hz = 50.0
[channel.uplink]
delay_ms = 20.0
prr = 0.5
EOF
start_nodes scenario.toml

# --- messages, one a line, with all fields by name
"$tether" echo --count 400 >all.txt
[ "$(grep -c ' utime=' all.txt)" = 400 ] || fail "--count 400 printed $(grep -c ' utime=' all.txt)"
for line in \
    '^AGV/POSE pose_t utime=[0-9]+ seq=[0-9]+ run=[0-9]+ x_m=[-0-9.e]+ y_m=[-0-9.e]+ yaw_rad=[-0-9.e]+ plan_session=-1 plan_id=-1$' \
    '^CTRL/CMD_VEL twist_t utime=[0-9]+ seq=[0-9]+ run=[0-9]+ pose_utime=[0-9]+ v_mps=.* omega_radps=' \
    '^SIM/CLOCK clock_t utime=[0-9]+ seq=[0-9]+ run=[0-9]+ rate=1$' \
    '^NET/COUNTERS counters_t .* node=netem count=[0-9]+ name=\[uplink.* value=\[[0-9]+, ' \
    '^CTRL/REPORT controller_report_t .* pose_timed_out=false$' \
    '^NET/UPLINK link_report_t .* link=uplink state=0 state_prr=0.5 state_delay_ms=20 ' \
    '^SIM/TRUTH ground_truth_t .* wall_contact=false$'; do
    grep -Eq "$line" all.txt || fail "no line like $line in all.txt"
done

# --- the summary: column 3 is the count, 4 the rate, 5 the missed
value() { awk -v channel="$1" -v column="$2" '$1 == channel { print $column }' "$3"; }
near() { awk -v x="$1" -v low="$2" -v high="$3" 'BEGIN { exit !(x >= low && x <= high) }'; }

"$tether" echo '(AGV|CTRL)/POSE' --quiet --duration 6 >poses.txt
[ "$(grep -c '_t ' poses.txt)" = 2 ] || fail "the regex chose other channels: $(cat poses.txt)"
near "$(value AGV/POSE 4 poses.txt)" 48 52 || fail "AGV/POSE is not at 50 Hz: $(cat poses.txt)"
[ "$(value AGV/POSE 5 poses.txt)" = 0 ] || fail "AGV/POSE lost messages: $(cat poses.txt)"
# Half of 300 get lost: five standard deviations are 43.
near "$(value CTRL/POSE 5 poses.txt)" 105 195 || fail "CTRL/POSE should miss half: $(cat poses.txt)"
sent=$(value AGV/POSE 3 poses.txt)
seen=$(($(value CTRL/POSE 3 poses.txt) + $(value CTRL/POSE 5 poses.txt)))
near $((sent - seen)) -10 10 || fail "AGV/POSE $sent, but CTRL/POSE $seen: $(cat poses.txt)"

# --- ends orderly on a signal
start quiet "$tether" echo --quiet
sleep 1
stop "$started"
grep -q '^SIM/TRUTH  *ground_truth_t' quiet.out || fail "no summary after SIGTERM: $(cat quiet.err)"
stop_nodes

# --- garbage: datagrams as LCM sends them ("LC02", number, channel, NUL, payload) and worse
start garbage "$tether" echo
garbage=$started
hears() { bash -c "printf '$1' >/dev/udp/239.255.76.67/7667" && grep -Fq "$2" garbage.out; }
expect() { wait_until 10 hears "$1" "$2" || fail "no \"$2\" after sending $1: $(cat garbage.out)"; }
expect 'LC02\0\0\0\1JUNK\0\1\2\3\4\5\6\7\10\11' 'JUNK 0x0102030405060708 (unknown type, 9 bytes)'
expect 'LC02\0\0\0\1SHORT\0\1\2' 'SHORT - (unknown type, 2 bytes)'
expect 'LC02\0\0\0\1\033[2J\0\1\2' '\x1b[2J - (unknown type, 2 bytes)'
for bytes in 'x' 'LC02' 'LC02\0\0\0\1' 'LC02\0\0\0\1NO_END' 'LC02\0\0\0\1\0' 'LC03\0\0\0\1' \
    'LC03\0\0\0\1\377\377\377\377\0\0\0\0\0\0\0\2X\0' '\377\377\377\377\377\377\377\377\377'; do
    bash -c "printf '$bytes' >/dev/udp/239.255.76.67/7667"
done
expect 'LC02\0\0\0\1AFTER\0\1' 'AFTER - (unknown type, 1 bytes)'
stop "$garbage"
grep -Eq '^JUNK +0x0102030405060708 ' garbage.out || fail "garbage is not in the summary"

# --- bad usage
refuses() {
    code=$1
    text=$2
    shift 2
    status=0
    "$tether" "$@" >refused.out 2>refused.err || status=$?
    [ "$status" = "$code" ] || fail "tether $*: exit code $status, not $code: $(cat refused.err)"
    grep -Fq -- "$text" refused.err || fail "tether $*: no \"$text\" in: $(cat refused.err)"
}
refuses 2 'channel: "AGV/[" is not a regular expression' echo 'AGV/['
refuses 2 'no port' echo --lcm-url udpm://239.255.76.67
refuses 2 '--count' echo --count 0
refuses 2 '--duration' echo --duration -1
start full sh -c "'$tether' echo --duration 0.2 >/dev/full"
status=0
wait "$started" || status=$?
[ "$status" = 1 ] || fail "a full disk: exit code $status, not 1"
grep -q 'cannot write standard output: No space left' full.err || fail "full disk: $(cat full.err)"
echo "passed: echo decodes 7 types, counts losses, survives garbage"
