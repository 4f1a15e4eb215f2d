#!/bin/sh
# `tether spy` on live traffic: lcm-spy lists the project's channels with their types, a rate above
# zero and no undecodable message, as read off a screenshot.
# Usage: spy_test.sh BIN_DIR [PICTURE.png]; also makes the manual's picture.
set -eu
picture=${2:+$(realpath -m "$2")}
# shellcheck source=tests/live/live_helpers.sh
. "$(dirname "$0")/live_helpers.sh"
need Xvfb xvfb
need import imagemagick
need convert imagemagick
need tesseract tesseract-ocr
if [ -n "$picture" ]; then need xdotool xdotool; fi

cat >scenario.toml <<'EOF'
[run]
duration_s = 600.0
[sensor]
odometry_rate_hz = 50.0
[lidar]
model = "custom"
[localiser]
place = "edge"
[channel.uplink]
delay_ms = 20.0
prr = 0.9
[channel.downlink]
delay_ms = 20.0
prr = 0.9
EOF

displayed() { [ -s display ]; }
Xvfb -displayfd 3 -screen 0 1280x760x24 -nolisten tcp 3>display >xvfb.out 2>xvfb.err &
pids="$pids $!"
wait_until 20 displayed || fail "Xvfb did not start: $(cat xvfb.err)"
DISPLAY=:$(cat display)
export DISPLAY

# A second localiser, on the vehicle: for poses and places on both sides of the network.
sed 's/"edge"/"vehicle"/' scenario.toml >on_vehicle.toml

start_nodes scenario.toml
start localiser "$bin/tether-localiser" scenario.toml
start localiser_on_vehicle "$bin/tether-localiser" on_vehicle.toml
start spy "$bin/tether" spy
spy=$started

# Recognition confuses / with l, I, U or Y and 0 with O, and loses underscores: a line fits if the
# letters around them do. Each: channel, type, count, rate above zero, ..., 0 undecodable at its end.
rate='([1-9][0-9]*[.,][0-9]{2}|0[.,]([1-9][0-9]|0[1-9]))'
line_with() {
    grep -Eq "^$1 +$2 +[0-9]+ +$rate .* [0Oo]\$" read.txt
}
all_lines() {
    while read -r channel type; do
        if ! line_with "$channel" "$type"; then
            unread="$channel of type $type"
            return 1
        fi
    done <<'EOF'
AGV.{0,3}CMD.{0,3}VEL twist.{0,3}t
AGV.{0,3}LOCALISATION localisation.{0,3}t
AGV.{0,3}ODOMETRY odometry.{0,3}t
AGV.{0,3}POSE pose.{0,3}t
AGV.{0,3}SCAN scan.{0,3}t
AGV.{0,3}SCAN.{0,3}PART scan.{0,3}part.{0,3}t
CTR.{0,3}CMD.{0,3}VEL twist.{0,3}t
CTR.{0,3}COUNTERS counters.{0,3}t
CTR.{0,3}LOCALISATION localisation.{0,3}t
CTR.{0,3}ODOMETRY odometry.{0,3}t
CTR.{0,3}POSE pose.{0,3}t
CTR.{0,3}REPORT controller.{0,3}report.{0,3}t
CTR.{0,3}SCAN.{0,3}PART scan.{0,3}part.{0,3}t
NET.{0,3}COUNTERS counters.{0,3}t
NET.{0,3}DOWNLIN.? link.{0,3}report.{0,3}t
NET.{0,3}UPLIN.? link.{0,3}report.{0,3}t
SIM.{0,3}CLOC.? clock.{0,3}t
SIM.{0,3}COUNTERS counters.{0,3}t
SIM.{0,3}TRUTH ground.{0,3}truth.{0,3}t
EOF
}

# The first messages of a channel have no rate yet, so the first pictures need not fit. The
# threshold keeps the black letters and drops the table's grey lines.
attempt=0
until [ -s read.txt ] && all_lines; do
    attempt=$((attempt + 1))
    if [ "$attempt" -gt 25 ]; then
        echo "read from $work/shot.png:" >&2
        cat read.txt spy.err >&2
        fail "no picture of lcm-spy showed $unread"
    fi
    if gone "$spy"; then fail "tether spy ended: $(cat spy.out spy.err)"; fi
    sleep 1
    import -window root shot.png
    scale=$((300 + attempt % 2 * 100))
    convert shot.png -crop 800x600+0+0 +repage -colorspace Gray -threshold 35% \
        -bordercolor white -border 20 -resize $scale% large.png
    OMP_THREAD_LIMIT=1 tesseract large.png read --psm 6 2>tesseract.err ||
        fail "tesseract: $(cat tesseract.err)"
done

# Beside the table: the fields of CTRL/REPORT, and the plot of one of them.
make_picture() {
    xdotool mousemove 60 220 click --repeat 2 --delay 80 1
    wait_until 10 xdotool search --onlyvisible --name '^CTRL/REPORT' >window || return 1
    fields=$(tail -n 1 window)
    xdotool windowmove "$fields" 0 360 windowsize "$fields" 650 240
    xdotool mousemove 550 503 click 1
    wait_until 10 xdotool search --onlyvisible --name '^distance_error_m' >window || return 1
    plot=$(tail -n 1 window)
    xdotool windowmove "$plot" 802 0 windowsize "$plot" 470 600
    sleep 12 # for the curves to show something
    import -window root picture.png
    convert picture.png -crop 1272x600+0+0 +repage -colors 64 -strip "$picture"
}
if [ -n "$picture" ]; then
    make_picture || fail "lcm-spy opened no window for CTRL/REPORT"
fi
echo "passed: lcm-spy decoded all 19 channels (picture $attempt)"
