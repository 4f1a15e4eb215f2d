#!/bin/sh
# Sets up the network that with_can.sh promises, then becomes the given command.
set -eu
ip link set lo up
ip route add 224.0.0.0/4 dev lo
for interface in vcan0 vcan1; do
    ip link add dev $interface type vcan
    ip link set $interface up
done
exec "$@"
