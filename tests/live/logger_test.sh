#!/bin/sh
# Tether's messages work with LCM's own tools: a live run recorded by lcm-logger and played by
# lcm-logplayer makes a fresh controller see the same poses and decide the same commands; the log
# of a simulated run plays, too; and logs that broke off are still read.
# Usage: logger_test.sh BIN_DIR
set -eu
# shellcheck source=tests/live/live_helpers.sh
. "$(dirname "$0")/live_helpers.sh"
need lcm-logger liblcm-bin
need lcm-logplayer liblcm-bin
tether=$bin/tether
# LCM 1.3.1 keeps networks on one machine apart by port, not by group.
live='udpm://239.255.76.67:7667?ttl=0'
replay='udpm://239.255.76.67:7668?ttl=0'

cat >scenario.toml <<'EOF'
[run]
duration_s = 600.0
[sensor]
rate_hz = 20.0
[channel.uplink]
delay_ms = 30.0
prr = 0.8
EOF

# record NAME URL: lcm-logger in the background. (Its -l is broken in LCM 1.3.1, --lcm-url works.)
record() {
    start "$1-logger" lcm-logger --quiet --flush-interval=50 --lcm-url="$2" "$1.lcmlog"
    logger=$started
    sleep 0.5 # it says nothing when it has subscribed
}

# --- record a live run from before its start
record live "$live"
start_nodes scenario.toml
recorded_enough() { [ "$("$tether" log csv live.lcmlog CTRL/REPORT 2>/dev/null | wc -l)" -ge 160 ]; }
wait_until 30 recorded_enough || fail "no 160 decisions within 30 s: $("$tether" log info live.lcmlog)"
stop_nodes
stop "$logger"
"$tether" log info live.lcmlog >live.info
for channel in AGV/POSE CTRL/POSE CTRL/CMD_VEL AGV/CMD_VEL CTRL/REPORT SIM/CLOCK SIM/TRUTH; do
    grep -q "^$channel " live.info || fail "$channel was not recorded: $(cat live.info)"
done
# Whole, since lcm-logger ended orderly.
if grep -Eq 'TRUNCATED|DAMAGED' live.info; then fail "lcm-logger's log: $(cat live.info)"; fi

# --- play only what the controller hears to a fresh controller, and record that
record replay "$replay"
start replayed "$bin/tether-controller" scenario.toml --lcm-url "$replay"
controller=$started
waiting() { grep -q 'waiting for SIM/CLOCK' replayed.err; }
wait_until 10 waiting || fail "the controller did not start: $(cat replayed.err)"
sleep 0.3
lcm-logplayer --lcm-url="$replay" --regexp='SIM/CLOCK|CTRL/POSE' live.lcmlog >player.out 2>&1 ||
    fail "lcm-logplayer: $(cat player.out)"
sleep 0.3
stop "$controller"
stop "$logger"
"$tether" log info replay.lcmlog >replay.info
if grep -q '^SIM/TRUTH ' replay.info; then fail "--regexp was ignored: $(cat replay.info)"; fi

# The same poses arrived, to the bit: all columns but the log's own time.
for log in live replay; do
    "$tether" log csv $log.lcmlog CTRL/POSE | cut -d, -f2- >$log.poses
    "$tether" log csv $log.lcmlog CTRL/REPORT --out $log.reports
done
cmp live.poses replay.poses || fail "the replayed poses differ from the recorded ones"

# The same decisions, pose by pose. Not to the bit: the law looks tau ahead from the time at which
# a pose arrives, and that varies by milliseconds. Columns: 4 pose_utime, 5 pose_seq, 9 v, 10 omega.
cat >compare.awk <<'EOF'
BEGIN { FS = "," }
FNR == 1 { next }
NR == FNR { utime[$5] = $4; v[$5] = $9; omega[$5] = $10; recorded++; next }
!($5 in v) { print "pose " $5 " was decided on only in the replay"; bad = 1; next }
$4 != utime[$5] { print "pose " $5 " has utime " $4 ", recorded " utime[$5]; bad = 1 }
{
    replayed++
    dv = $9 - v[$5]; domega = $10 - omega[$5]
    dv = dv < 0 ? -dv : dv; domega = domega < 0 ? -domega : domega
    if (dv > dv_max) dv_max = dv
    if (domega > domega_max) domega_max = domega
    if (dv > 0.05 || domega > 0.02) differing++
}
END {
    printf "%d of %d decisions, %d differ by > 0.05 m/s or > 0.02 rad/s; most %.4f and %.4f\n",
        replayed, recorded, differing, dv_max, domega_max
    # The controller joins at the first SIM/CLOCK that it hears; and a busy machine may well be late
    # now and then.
    exit bad || replayed < recorded - 3 || differing > 0.05 * recorded
}
EOF
awk -f compare.awk live.reports replay.reports >verdict || fail "replay: $(cat verdict)"

# --- a log that breaks off is read up to there, and says so
size=$(wc -c <live.lcmlog)
head -c $((size - 7)) live.lcmlog >cut.lcmlog
"$tether" log info cut.lcmlog >cut.info
grep -q '^TRUNCATED: .* bytes lost$' cut.info || fail "not marked as truncated: $(cat cut.info)"

# --- killed, lcm-logger leaves a log that is read, less the last moments
record killed "$live"
start_nodes scenario.toml
recording() { "$tether" log info killed.lcmlog | grep -q '^SIM/TRUTH '; }
wait_until 10 recording || fail "nothing recorded: $(cat ./*.err)"
kill -KILL "$logger"
stop_nodes
"$tether" log csv killed.lcmlog SIM/TRUTH >killed.csv
[ "$(wc -l <killed.csv)" -gt 1 ] || fail "nothing left after kill -9"

# --- the log of a simulated run: stamped with simulated time, read and played like any other
"$tether" run scenario.toml --set run.duration_s=10 --out run >run.out
"$tether" log info run/run.lcmlog >run.info
grep -Eq '^duration (9\.[5-9]|10\.0)' run.info || fail "not 10 s of simulated time: $(cat run.info)"
poses=$("$tether" log csv run/run.lcmlog AGV/POSE | wc -l)
start simulated "$tether" echo AGV/POSE --lcm-url "$replay" --count $((poses - 1))
echo=$started
sleep 0.5
lcm-logplayer --speed=10 --lcm-url="$replay" run/run.lcmlog >player.out 2>&1 ||
    fail "lcm-logplayer on run.lcmlog: $(cat player.out)"
wait_until 10 gone "$echo" || fail "echo did not hear all of run.lcmlog: $(tail -n 3 simulated.out)"
grep -Eq "^AGV/POSE +pose_t +$((poses - 1)) +[0-9.]+ +0 " simulated.out ||
    fail "run.lcmlog, played: $(tail -n 3 simulated.out)"
echo "passed: replay made $(cat verdict)"
