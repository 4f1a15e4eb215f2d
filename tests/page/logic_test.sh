#!/bin/sh
# The parts of the page that need no browser, in Node.js.
set -eu
command -v node >/dev/null || {
    echo "FAILED: node is missing; on Debian: sudo apt-get install nodejs (or ./setup.sh tests)"
    exit 1
}
cd "$(dirname "$0")"
exec node --test connection_test.mjs embedded_test.mjs fleet_test.mjs model_test.mjs onboard_test.mjs
