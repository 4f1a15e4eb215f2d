#!/bin/sh
# Runs a command in a network of its own: loopback with a multicast route, nothing else. LCM tests
# on one machine would otherwise hear each other (LCM 1.3.1 separates networks by port only).
# Root needs `unshare`; other users need unprivileged user namespaces.
# CTest says on which processor, by the preset's processors.json; without that, one at a time.
set -eu
if [ "${TETHER_OWN_NETWORK:-}" != yes ]; then
    export TETHER_OWN_NETWORK=yes
    if [ -n "${TETHER_REAL_TIME:-}" ]; then # ahead of other work, where that is allowed
        renice --priority -10 --pid $$ >/dev/null 2>&1 || true
    fi
    if [ -n "${CTEST_RESOURCE_GROUP_0_PROCESSORS:-}" ]; then
        id=${CTEST_RESOURCE_GROUP_0_PROCESSORS#id:}
        taskset --cpu-list --pid "${id%%,*}" $$ >/dev/null 2>&1 || true
    elif [ -n "${TETHER_REAL_TIME:-}" ]; then
        exec 9>"${TMPDIR:-/tmp}/tether_real_time_$(id -u)"
        flock 9
    fi
    if [ "$(id -u)" = 0 ]; then
        exec unshare --net "$0" "$@"
    fi
    exec unshare --net --user --map-root-user "$0" "$@"
fi
ip link set lo up
ip route add 224.0.0.0/4 dev lo
exec "$@"
