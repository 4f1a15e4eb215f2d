#!/usr/bin/env bash
# floor_in_a_box_test.sh BUILD: the example floor_in_a_box.sh, with what `cmake --install` puts into a folder
# of its own, where kernel and network are as it needs them.
set -euo pipefail
here=$(dirname "$(readlink -f "$0")")
prefix=$(mktemp -d "$1/floor_in_a_box.XXXXXX")
trap 'rm -rf "$prefix"' EXIT
for component in vehicle lab doc; do
    cmake --install "$1" --prefix "$prefix" --component $component >/dev/null
done
cd "$prefix"
export PATH=$prefix/bin:/usr/sbin:/usr/bin:/sbin:/bin
"$here/../uml/with_can.sh" "$prefix/share/doc/tether/examples/floor_in_a_box.sh"
