#!/bin/sh
# Programs of one host hear each other whatever interfaces and routes it has: the LCM tests, a run in
# lockstep and a live run in networks that differ in them. Usage: interfaces_test.sh BIN_DIR
set -eu
bin=$1
source=$(dirname "$(readlink -f "$0")")/../..
tests=$bin/../tests

# network NAME ip-arguments...: one that has lo, and what these commands of ip add, separated by +.
network() {
    echo "--- $1"
    shift
    unshare --net sh -euc '
        ip link set lo up
        ip link add eth0 type dummy
        ip addr add 10.11.12.13/24 dev eth0
        ip link set eth0 up
        bin=$1 source=$2 tests=$3
        shift 3
        line=
        for word in "$@" +; do
            if [ "$word" = + ]; then [ -z "$line" ] || ip $line; line=; else line="$line $word"; fi
        done
        ip -brief addr; ip route
        "$tests/lcm_bus_test" --gtest_brief=1
        "$bin/tether" run "$source/scenarios/paper.toml" --processes --set=run.duration_s=5
        "$bin/tether" live "$source/scenarios/paper.toml" --duration=2
    ' sh "$bin" "$source" "$tests" "$@"
}

network "a second interface, multicast by lo" route add 239.255.76.67/32 dev lo
network "multicast by the second interface" route add 224.0.0.0/4 dev eth0
network "only a default route" route add default via 10.11.12.1
network "a default route, multicast by lo" \
    route add default via 10.11.12.1 + route add 239.255.76.67/32 dev lo
network "two addresses" \
    addr add 10.99.0.1/16 dev eth0 + route add 224.0.0.0/4 dev eth0 src 10.99.0.1
network "two interfaces" link add eth1 type dummy + addr add 10.99.0.1/16 dev eth1 + \
    link set eth1 up + route add 239.255.76.67/32 dev eth1 + route add default via 10.11.12.1
