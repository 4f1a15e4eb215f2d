#!/usr/bin/env bash
# A whole floor in a box: control host and vehicle as two network namespaces, a bad network between them,
# drives on CAN. From bare namespaces to an e-stop, each step as on real hosts, where `on control` is a
# terminal there. The programs are those on PATH; no file is left behind.
#
#   sudo ./floor_in_a_box.sh        # Linux with vcan; tc's netem, if it has that
#
# In a source tree on a machine without vcan it starts itself in User-Mode Linux, without sudo. Exit code:
# 0 if all that it measures is as it should be; each step is a line.
#   DRIVE_S=25      how long to drive, 5 to 35 s
#   FLOOR=relay     tether-netem spoils poses and commands, as where the kernel has no netem
set -euo pipefail
drive_s=${DRIVE_S:-25}
scenario=scenarios/floor_in_a_box.toml  # comes with Tether: share/tether/scenarios
self=$(readlink -f "$0")

# 0. What is needed.
say() { printf '%-9s %s\n' "$1" "$2"; }
give_up() { echo "floor_in_a_box.sh: $*" >&2 && exit 1; }
if ! unshare --net ip link add name probe type vcan 2>/dev/null; then
    in_guest=$(dirname "$self")/../tests/uml/with_can.sh
    [ -z "${TETHER_CAN_KERNEL:-}" ] && [ -x "$in_guest" ] && exec "$in_guest" "$self"
    give_up "no CAN interface can be made: be root, and modprobe vcan (Debian: in linux-image-amd64)"
fi
for program in tether{,-sim,-controller,-netem,-link,-can-bridge,-can-drive} lcm-logger ip awk; do
    command -v "$program" >/dev/null || give_up "no $program on PATH: apt install tether liblcm-bin iproute2"
done

work=$(mktemp -d)
clean_up() {
    local code=$?
    trap - EXIT
    jobs -p | xargs --no-run-if-empty kill 2>/dev/null || true
    wait
    [ $code = 0 ] || tail -n 5 "$work"/*.said 2>/dev/null || true
    for host in control vehicle; do ip netns delete $host.$$ 2>/dev/null || true; done
    rm -rf "$work"
}
trap clean_up EXIT
trap 'exit 1' INT TERM

# 1. Two hosts, a cable between them, and CAN on the vehicle.
on() { ip netns exec "$1.$$" "${@:2}"; }  # a command on a host
for host in control vehicle; do
    ip netns add $host.$$
    on $host ip link set lo up
    on $host ip route add 224.0.0.0/4 dev lo  # LCM stays on its host
done
ip link add name radio netns control.$$ type veth peer name radio netns vehicle.$$
on control ip address add 192.0.2.1/24 dev radio
on vehicle ip address add 192.0.2.2/24 dev radio
for host in control vehicle; do on $host ip link set radio up; done
on vehicle ip link add name vcan0 type vcan
on vehicle ip link set vcan0 up
say hosts "192.0.2.1 (control) and 192.0.2.2 (vehicle, with vcan0), Linux $(uname -r)"

# 2. A bad network: as the scenario says, in both directions.
spoil() { # side, direction
    local impair
    read -ra impair <<<"$(tether netem export-tc $scenario --interface radio | grep -A 1 "^# $2" | grep ^tc)"
    on "$1" "${impair[@]}" 2>/dev/null
}
if [ "${FLOOR:-}" != relay ] && spoil vehicle uplink && spoil control downlink; then
    air=tc
    pose=CTRL/POSE command=CTRL/CMD_VEL  # on the control side of its link
    say network "tc's netem: $(on control tc qdisc show dev radio | grep -o 'delay.*')"
else
    air=relay
    pose=AIR/POSE command=AIR/CMD_VEL
    say network "tether-netem, for poses and commands"
fi

# 3. Keys, and who may send what to whom.
configure() { # host, address, peer, its address, its key, send, receive
    cat >"$work/$1.toml" <<END
key = "$1.key"
lcm_url = "udpm://239.255.76.67:7667?ttl=0"
[[path]]
name = "radio"
bind = "$2:7700"
[[peer]]
name = "$3"
public_key = "$5"
addresses = ["$4:7700"]
send = [$6]
receive = [$7]
latest_only = [".*/(POSE|CMD_VEL|STATE)"]
END
    chmod 644 "$work/$1.toml"
}
control_key=$(tether-link keygen "$work/control.key")
vehicle_key=$(tether-link keygen "$work/vehicle.key")
configure control 192.0.2.1 vehicle 192.0.2.2 "$vehicle_key" \
    "\"$command -> AGV/CMD_VEL\", \"CAN/REQUEST\"" "\"$pose\", \"CAN/STATE\""
configure vehicle 192.0.2.2 control 192.0.2.1 "$control_key" \
    "\"AGV/POSE -> $pose\", \"CAN/STATE\"" '"AGV/CMD_VEL", "CAN/REQUEST"'
say keys "control ${control_key:0:8}…, vehicle ${vehicle_key:0:8}…"

# 4. Both sides. All nodes get the same t = 0; the vehicle stands until then.
start_us=$(($(date +%s%6N) + 10000000))
run() { # host, program, arguments
    on "$@" >>"$work/$1-${2##*/}.said" 2>&1 &
}
node() { run "$1" "$2" $scenario --start-utime $start_us "${@:3}"; }
run vehicle tether-link run "$work/vehicle.toml"
run vehicle lcm-logger --quiet "--channel=SIM/TRUTH|CAN/STATE|AGV/CMD_VEL" "$work/vehicle.lcmlog"
node vehicle tether-sim
node vehicle tether-can-drive
node vehicle tether-can-bridge
run control tether-link run "$work/control.toml"
run control lcm-logger --quiet "--channel=CTRL/POSE" "$work/control.lcmlog"
if [ $air = relay ]; then
    node control tether-netem --rule "AIR/POSE -> CTRL/POSE via uplink" \
        --rule "CTRL/CMD_VEL -> AIR/CMD_VEL via downlink"
fi
node control tether-controller

# 5. The operator arms from the control side. Until it has worked: requests may be lost.
now_us() { echo $(($(date +%s%6N) - start_us)); } # since t = 0
until answer=$(on control tether can arm 2>&1); do
    [ "$(now_us)" -lt -1000000 ] || give_up "not armed before t = 0: $answer"
done
say armed "$answer"

# 6. Drive; then an e-stop from the control side, over the same network.
sleep "$(awk "BEGIN { print $drive_s - $(now_us) / 1e6 }")"
pressed_us=$(now_us)
on control tether can estop >"$work/estop.said" 2>&1 || give_up "the e-stop was not confirmed"
sleep 3
say e-stop "$(cat "$work/estop.said")"
for job in $(jobs -p); do
    kill -0 "$job" 2>/dev/null || give_up "a program has ended"
done
jobs -p | xargs kill
wait

# 7. What was recorded, and what it should be.
column() { # log, channel, fields…: those columns, without the head
    tether log csv "$work/$1.lcmlog" "$2" | awk -F, -v names="${*:3}" '
        NR == 1 { n = split(names, name, " "); for (i = 1; i <= NF; ++i) at[$i] = i; next }
        { for (i = 1; i <= n; ++i) printf "%s ", $(at[name[i]]); print "" }'
}
failures=0
judge() { # step, text, condition (awk)
    if awk "BEGIN { exit !($3) }"; then
        say "$1" "$2"
    else
        say "$1" "$2   NOT AS IT SHOULD BE: $3"
        failures=$((failures + 1))
    fi
}

# The path error as in virtual time; its channel draws other losses.
error_m=$(column vehicle SIM/TRUTH utime epsilon_m | awk "\$1 <= $pressed_us { e = \$2 } END { print e }")
simulated_m=$(tether run $scenario --set can.arm=once --set run.duration_s="$drive_s" --json |
    awk -F'[:,]' '$1 ~ /"epsilon_m"/ { print $2 + 0 }')
judge path "$(printf 'error %.3f m, in virtual time %.3f m' "$error_m" "$simulated_m")" \
    "$error_m / $simulated_m > 0.9 && $error_m / $simulated_m < 1.1"
read -r armed cycles <<<"$(column vehicle CAN/STATE utime state |
    awk "\$1 > 0 && \$1 < $pressed_us { ++n; armed += \$2 == 4 } END { print armed + 0, n + 0 }")"
judge driving "armed in $armed of $cycles control cycles" "$armed == $cycles && $cycles > 40 * $drive_s"

# 94.9 % each way, in bursts of 1.3 datagrams: 4.5 sigma of 500 are 5.5 %.
reception() { # log, channel: numbers that came, of those between the first and the last
    column "$1" "$2" utime seq | awk "\$1 > 0 && \$1 < $pressed_us && !seen[\$2]++ {
        if (!n++) first = \$2; if (\$2 > last) last = \$2 } END { print n ? n / (last - first + 1) : 0 }"
}
for way in "uplink control CTRL/POSE" "downlink vehicle AGV/CMD_VEL"; do
    read -r name log channel <<<"$way"
    share=$(reception "$log" "$channel")
    judge "$name" "$(awk "BEGIN { printf \"%.1f %% of %s arrived\", 100 * $share, \"$channel\" }")" \
        "$share > 0.89 && $share < 0.995"
done

# From the request's arrival: reaction (0.1 s and five cycles of 20 ms), and the drives' quick stop (4 m/s²).
acted_us=$(column vehicle CAN/STATE utime state | awk "\$1 > $pressed_us && \$2 != 4 && !n++ { print \$1 }")
read -r rest_us speed_mps <<<"$(column vehicle SIM/TRUTH utime left_rim_mps right_rim_mps | awk "
    function size(x) { return x < 0 ? -x : x }
    { rim = size(\$2) > size(\$3) ? size(\$2) : size(\$3) }
    \$1 <= $acted_us { speed = rim }
    rim > 0.005 { rest = 0; next }
    !rest { rest = \$1 }
    END { print rest ? rest : 1e12, speed }")"
judge request "$(awk "BEGIN { printf \"%.2f s from the operator's Enter to the bridge\", ($acted_us - $pressed_us) / 1e6 }")" \
    "$acted_us - $pressed_us < 1e6"
stop_s=$(awk "BEGIN { print ($rest_us - $acted_us) / 1e6 }")
allowed_s=$(awk "BEGIN { print 0.2 + $speed_mps / 4 }")
judge stop "$(printf 'wheels at rest after %.2f s, from %.2f m/s; promised %.2f s' "$stop_s" "$speed_mps" "$allowed_s")" \
    "$stop_s <= $allowed_s && $speed_mps > 0.5"
[ $failures = 0 ] || exit 1
say ok "all as it should be"
