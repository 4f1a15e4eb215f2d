#!/usr/bin/env bash
# Runs a command in a network of its own that has CAN, as root of that network: lo with a multicast
# route for LCM, vcan0 and vcan1 (up), and whatever interfaces the command makes itself.
#   with_can.sh COMMAND ARGS...
#   with_can.sh --where     only says where it would run
#   with_can.sh --guest …   always in User-Mode Linux: a machine that may be spoilt
#   with_can.sh --host-clock …   a guest's time is this machine's: to measure how long things take.
#                           Else a guest does not see that it is kept waiting (guest_clock.cpp)
#   with_can.sh --netem …   either, in a network that has tc's netem instead, and lo alone
# Natively where this kernel can do it, else in User-Mode Linux, which needs neither root nor KVM:
# a Linux kernel as a process, whose root file system is this machine's own, with this user's
# rights; one CPU, 1 GB; /dev, /run, $HOME and $TMPDIR are its own.
# The first line of output says where it runs. Exit code: the command's; 1 if it could not be run
# or did not end in time.
#   TETHER_CAN_TIMEOUT  seconds after which everything is killed (300)
# The command finds TETHER_CAN_KERNEL = native or uml.
#   TETHER_CAN_RESULTS  an existing folder for files that outlive the command: $TMPDIR does not
set -euo pipefail
here=$(dirname "$(readlink -f "$0")")
timeout_s=${TETHER_CAN_TIMEOUT:-300}
network=vcan
native=yes
clock=guest
case "${1:-}" in
    --netem) network=netem && shift ;;
    --host-clock) clock=host && shift ;;
    --guest) native=no && shift ;;
esac
# Debian's tools first: its python3 is the one that has python3-can.
export PATH=/usr/sbin:/usr/bin:/sbin:/bin:$PATH

isolate() { # unshare's options and command; for others than root in a user namespace
    local user=()
    [ "$(id -u)" = 0 ] || user=(--user --map-root-user)
    exec setpriv --pdeathsig KILL unshare "${user[@]}" "$@"
}

native_has_vcan() { # and, for all tests, serial-line CAN, which wants the machine's root
    [ "$(id -u)" = 0 ] || return 1
    (isolate --net "$here/vcan_network.sh" ip link add type vxcan) >/dev/null 2>&1 || return 1
    [ -d /sys/module/slcan ] || modprobe --quiet slcan
}

native_has_netem() {
    (isolate --net sh -c "tc qdisc add dev lo root handle 1: prio &&
        tc qdisc add dev lo parent 1:1 netem delay 1ms") >/dev/null 2>&1
}

say_native() { echo "$network: native, Linux $(uname -r)"; }
say_uml() { echo "$network: User-Mode Linux $("$uml" --version)"; }

run_native() {
    say_native
    export TETHER_CAN_KERNEL=native
    isolate --net "$here/${network}_network.sh" timeout --kill-after=5 "$timeout_s" "$@"
}

run_in_uml() {
    export TETHER_CAN_KERNEL=uml
    job=$(mktemp -d)
    trap '[ -z "${uml_pid:-}" ] || kill -KILL "$uml_pid" 2>/dev/null || true; wait 2>/dev/null; rm -rf "$job"' EXIT
    trap 'exit 1' HUP INT TERM
    export -p >"$job/environment"
    printf '%q ' "$@" >"$job/command"
    local preloads=()
    [ $clock = host ] || preloads+=("$here/guest_clock.cpp")
    if grep --quiet --word-regexp amx_tile /proc/cpuinfo; then
        preloads+=("$here/whole_xstate.cpp")
    fi
    uml_environment=()
    if [ ${#preloads[@]} != 0 ]; then
        c++ -std=c++20 -O2 -shared -fPIC -o "$job/preload.so" "${preloads[@]}"
        uml_environment=("LD_PRELOAD=$job/preload.so")
    fi

    # Its memory is a file: best in a tmpfs that is large enough and may be executed from.
    memory=/dev/shm
    if [ "$(df --output=avail /dev/shm 2>/dev/null | tail -n 1)" -lt 1100000 ] ||
        findmnt --noheadings --output OPTIONS --target /dev/shm | grep --quiet noexec; then
        memory=$job
    fi
    say_uml
    # On one of this machine's processors: its kernel and its processes take turns anyway, and to
    # wake each other on another processor is slow.
    local processor=${CTEST_RESOURCE_GROUP_0_PROCESSORS:-}
    if [[ $processor =~ ^id:([0-9]+) ]]; then
        processor=${BASH_REMATCH[1]}
    else
        processor=$(python3 -c "import os, random; print(random.choice([*os.sched_getaffinity(0)]))")
    fi
    # The process namespace dies as a whole: with this script, or at the end of the time.
    (isolate --pid --fork --kill-child -- timeout --kill-after=1 "$timeout_s" \
        taskset --cpu-list "$processor" env --chdir=/ "${uml_environment[@]}" TMPDIR="$memory" "$uml" rootfstype=hostfs rootflags=/ rw mem=1024M \
        uml_dir="$job/" con=null con0=null,fd:3 ssl=null ssl0=null,fd:1 quiet \
        init="$here/guest_init.py" tether_job="$job" tether_network="$network" \
        </dev/null 3>"$job/kernel_log") &
    uml_pid=$!
    wait "$uml_pid" || true
    uml_pid=
    if [ ! -s "$job/exit_code" ]; then
        echo "with_can.sh: User-Mode Linux ended before the command, or after $timeout_s s" >&2
        tail -n 20 "$job/kernel_log" >&2
        exit 1
    fi
    exit "$(cat "$job/exit_code")"
}

usage() { sed -n '/^# Runs/,/^set/s/^# \?//p' "$0"; }

if [ $# = 0 ]; then
    usage >&2
    exit 1
elif [ "$1" = --help ]; then
    usage
elif [ "$network" = netem ] && ! command -v tc >/dev/null; then
    echo "no tc: install iproute2" >&2
    exit 1
elif [ $native = yes ] && "native_has_$network"; then
    [ "$1" != --where ] || { say_native; exit; }
    run_native "$@"
elif uml=$(command -v linux.uml); then
    [ "$1" != --where ] || { say_uml; exit; }
    run_in_uml "$@"
else
    echo "no $network in this kernel and no User-Mode Linux: install user-mode-linux" >&2
    exit 1
fi
