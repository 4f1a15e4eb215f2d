# shellcheck shell=sh
# Sourced by the scripts that test with live LCM traffic: checks of tools, bounded waits, and the
# end of everything that was started. Sets bin (the folder of the programs) and work (the current
# folder, kept if the test fails), from the script's first argument.

fail() {
    echo "FAILED: $*" >&2
    exit 1
}

# need TOOL PACKAGE: a missing tool is a failure, not a reason to skip the test.
need() {
    command -v "$1" >/dev/null || fail "$1 is missing; on Debian: sudo apt-get install $2"
}

# wait_until SECONDS COMMAND...: polls until COMMAND succeeds; fails at the deadline.
wait_until() {
    tries=$(($1 * 10))
    shift
    until "$@"; do
        tries=$((tries - 1))
        [ "$tries" -gt 0 ] || return 1
        sleep 0.1
    done
}

# start NAME COMMAND...: in the background, output to NAME.out and NAME.err, pid in $started.
start() {
    name=$1
    shift
    : >"$name.out" 2>"$name.err" # there to be read at once
    "$@" >>"$name.out" 2>>"$name.err" &
    started=$!
    pids="$pids $started"
}

gone() {
    ! kill -0 "$1" 2>/dev/null
}

# stop PID: orderly, and by force after 10 s, which is a failure.
stop() {
    kill -TERM "$1" 2>/dev/null || true
    if ! wait_until 10 gone "$1"; then
        kill -KILL "$1"
        fail "process $1 did not end within 10 s of SIGTERM"
    fi
    wait "$1" 2>/dev/null || true
}

# start_nodes SCENARIO: simulator, relay and controller; their pids in $nodes.
start_nodes() {
    start netem "$bin/tether-netem" "$1"
    nodes=$started
    start controller "$bin/tether-controller" "$1"
    nodes="$nodes $started"
    start sim "$bin/tether-sim" "$1"
    nodes="$started $nodes"
    wait_until 10 grep -q running controller.err || fail "the controller did not start: $(cat ./*.err)"
}

stop_nodes() {
    for pid in $nodes; do stop "$pid"; done
}

end_all() {
    status=$?
    trap - EXIT
    for pid in $pids; do kill -TERM "$pid" 2>/dev/null || true; done
    for pid in $pids; do
        wait_until 5 gone "$pid" || kill -KILL "$pid" 2>/dev/null || true
    done
    if [ "$status" = 0 ]; then
        rm -rf "$work"
    else
        echo "what was written is in $work" >&2
    fi
    exit "$status"
}

[ $# -ge 1 ] || fail "usage: $0 BIN_DIR"
bin=$(cd "$1" && pwd)
pids=
nodes=
work=$(mktemp -d)
trap end_all EXIT
trap 'exit 1' HUP INT TERM
cd "$work"
