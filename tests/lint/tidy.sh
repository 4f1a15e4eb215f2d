#!/usr/bin/env bash
# clang-tidy finds nothing in any source. Usage: tidy.sh BUILD_DIR
#
# The sources of a folder are checked two dozen at a time, as one file that includes them: most of the
# work is in the system's headers, which they share. Sources that cannot be compiled together (two
# things of one name) are checked in halves, down to one by one.
set -euo pipefail
cd "$(dirname "$0")/../.."
build=$(readlink -f "$1")
command -v clang-tidy >/dev/null || { echo "clang-tidy is missing: apt install clang-tidy" >&2; exit 1; }

# Its commands without the compiler's precompiled headers, which clang-tidy cannot read.
commands=$(mktemp -d "$build/tidy_commands_XXXXXX")
trap 'rm -r "$commands"' EXIT
python3 - "$build" >"$commands/compile_commands.json" <<'EOF'
import json, re, sys
with open(sys.argv[1] + "/compile_commands.json") as file:
    commands = [c for c in json.load(file) if "cmake_pch" not in c["file"]]
folders = set(re.findall(r"-I\S+|-isystem \S+", " ".join(c["command"] for c in commands)))
for c in commands:  # sources that are checked together need the folders of any of them
    c["command"] = re.sub(r" -Winvalid-pch -include \S*cmake_pch\.hxx", "", c["command"])
    c["command"] += " " + " ".join(sorted(folders))
json.dump(commands, sys.stdout)
EOF

tidy() { # BUILD_DIR COMMANDS SOURCES...
    local build=$1 commands=$2 job status=0
    shift 2
    job=$(mktemp -d "$build/tidy_XXXXXX")
    if [ $# -gt 1 ]; then
        mkdir -p "$job/$(dirname "$1")" # where a file lies decides with which options it is compiled
        local together="$job/$(dirname "$1")/together.cpp"
        printf "#include \"$PWD/%s\"\n" "$@" >"$together"
        clang-tidy -p "$commands" --quiet --checks=-bugprone-suspicious-include \
            --header-filter="^$PWD/[a-z_/]+/[^/]*\.[ch]pp\$" "$together" >"$job/found" 2>&1 || status=1
    fi
    if [ $# = 1 ]; then
        clang-tidy -p "$commands" --quiet "$1" >"$job/found" 2>&1 || status=1
    elif grep --quiet 'clang-diagnostic-error' "$job/found"; then
        rm -r "$job"
        status=0
        tidy "$build" "$commands" "${@:1:$# / 2}" || status=1
        tidy "$build" "$commands" "${@:$# / 2 + 1}" || status=1
        return $status
    fi
    grep -v -E '^[0-9]+ warnings? (generated|treated)|^Suppressed|^Use -header-filter' "$job/found" || true
    rm -r "$job"
    return $status
}
export -f tidy

for folder in common sim controller netem can_bridge tools bench; do
    find "$folder" -name '*.cpp' ! -name '*main.cpp' ! -name '*_bench.cpp' | sort | xargs --max-args=24
    find "$folder" -name '*main.cpp' -o -name '*_bench.cpp' | sort | xargs --max-args=1
done | grep . | xargs --max-procs="$(nproc)" -I '{}' bash -c "tidy '$build' '$commands' {}"
echo "clang-tidy: clean"
