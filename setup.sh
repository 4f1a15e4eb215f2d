#!/usr/bin/env bash
# Installs, with apt, what is missing of Tether's Debian packages; says nothing if nothing is.
#   ./setup.sh          what building and running need
#   ./setup.sh tests    that, and what the tests need
#   ./setup.sh vehicle  what a vehicle's computer needs (-DTETHER_VEHICLE_ONLY=ON): less
set -euo pipefail

packages=(
    # compiler and build; ccache compiles again only what changed, in any clone
    g++ ccache cmake ninja-build pkg-config python3 git ca-certificates
    # pip install ./python
    python3-venv python3-pip
    # libraries
    liblcm-dev liblcm-bin libboost-dev libeigen3-dev libnlopt-dev libnlopt-cxx-dev libcli11-dev libfmt-dev
    libtomlplusplus-dev libyaml-cpp-dev libre2-dev libgpiod-dev libsodium-dev libsystemd-dev nlohmann-json3-dev
    # network set-up
    iproute2 nftables
)
if [ "${1:-}" != vehicle ]; then
    packages+=(
        libode-dev libsqlite3-dev libmuparser-dev libzstd-dev zlib1g-dev libgtest-dev libgmock-dev libbenchmark-dev
        # the Python module tether_env
        pybind11-dev python3-dev python3-numpy python3-setuptools
        # the door to ROS 2; without it tether-ros2 is left out
        cyclonedds-dev cyclonedds-tools
        # figures, charts, and lcm-spy with plots
        gnuplot-nox libjs-chart.js liblcm-java libjchart2d-java openjdk-17-jdk openjdk-17-jre
    )
fi
if [ "${1:-}" = tests ]; then
    packages+=(
        clang-format clang-tidy                     # lint
        clang lld libclang-rt-14-dev                # the sanitizers' build, by a second compiler
        xvfb xdotool imagemagick x11-utils tesseract-ocr tesseract-ocr-eng # lcm-spy's screenshot
        python3-pandas                              # for readers of runs
        python3-prometheus-client                   # for readers of metrics
        procps util-linux                           # process tests
        libfastrtps-dev                             # a second DDS, against tether-ros2
        rsync                                       # the upload of logs
        zsh groff-base                              # completion, manual pages
        dpkg-dev lintian systemd udev               # packages and services
        user-mode-linux can-utils python3-can tshark # tests on a CAN bus and against tc's netem
        iperf3 mosquitto mosquitto-clients curl     # foreign programs on a floor's hosts
        slurm-wlm munge                             # sweeps on a cluster
        chromium                                    # a report's screenshot, the page of tether view
        libns3-dev                                  # another simulator of Wi-Fi as a judge
    )
    # Readers of MCAP, by npm. Only what is missing: Node.js of its makers brings npm, and conflicts with
    # Debian's.
    command -v node >/dev/null || packages+=(nodejs)
    command -v npm >/dev/null || packages+=(npm)
fi

missing=()
for package in "${packages[@]}"; do
    [ "$(dpkg-query --show --showformat='${db:Status-Status}' "$package" 2>/dev/null)" = installed ] ||
        missing+=("$package")
done
[ ${#missing[@]} -gt 0 ] || exit 0

sudo=()
if [ "$(id -u)" != 0 ]; then
    command -v sudo >/dev/null || {
        echo "setup.sh: missing packages, and neither root nor sudo. As root: apt-get install ${missing[*]}" >&2
        exit 1
    }
    sudo=(sudo)
fi
echo "Installing: ${missing[*]}"
export DEBIAN_FRONTEND=noninteractive
"${sudo[@]}" apt-get update -qq
"${sudo[@]}" env DEBIAN_FRONTEND=noninteractive \
    apt-get install -y -qq --no-install-recommends "${missing[@]}" |
    awk '/^Setting up/ { n++; printf "\r  %d packages set up", n; fflush() } END { print "" }'
