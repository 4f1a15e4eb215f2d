#!/bin/sh
# Sets up the network that with_can.sh --netem promises, then becomes the given command.
set -eu
ip link set lo up
exec "$@"
