#!/bin/sh
# Runs a command in a network of its own: loopback with a multicast route, nothing else. LCM tests
# on one machine would otherwise hear each other (LCM 1.3.1 separates networks by port only).
# Root needs `unshare`; other users need unprivileged user namespaces.
set -eu
if [ "${TETHER_OWN_NETWORK:-}" != yes ]; then
    export TETHER_OWN_NETWORK=yes
    if [ "$(id -u)" = 0 ]; then
        exec unshare --net "$0" "$@"
    fi
    exec unshare --net --user --map-root-user "$0" "$@"
fi
ip link set lo up
ip route add 224.0.0.0/4 dev lo
exec "$@"
