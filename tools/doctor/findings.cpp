#include "tools/doctor/findings.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>

#include "common/lcm/lcm_url.hpp"

namespace tether {
namespace {

using Verdict = DoctorFinding::Verdict;

/// Minimum receive buffer, and the size for lockstep with large messages.
constexpr std::int64_t kLeastBuffer_bytes = 2'097'152, kGoodBuffer_bytes = 8'388'608;
/// Plans break at a clock 0.2 s off; a tenth of it is left to the clock.
constexpr double kClockError_ms = 20.0;
/// A setpoint that comes later than this part of a cycle moves visibly in the drive's ramp.
constexpr double kGoodShareOfCycle = 0.25;

DoctorFinding multicast(const Machine& m) {
  const std::string group = multicast_group(m.lcm_url);
  if (group.empty()) return {Verdict::good, "multicast", m.lcm_url + " needs none", ""};
  const bool stays_here = lcm_option(m.lcm_url, "ttl") == 0;
  if (m.multicast_interface == "lo") {
    const std::string what =
        fmt::format("{} is reached by the loopback interface: this host alone", group);
    if (stays_here) return {Verdict::good, "multicast", what, ""};
    return {Verdict::note, "multicast", what + ", though the LCM network has ttl=1 or more",
            fmt::format("sudo ip route del {}/32 dev lo; or ttl=0", group)};
  }
  if (!m.multicast_by.empty()) {
    const std::string what =
        fmt::format("{} is reached by {}{}", group, m.multicast_by,
                    m.multicast_interface.empty() ? "" : ", " + m.multicast_interface);
    if (!stays_here) return {Verdict::good, "multicast", what, ""};
    return {m.multicast_by_radio ? Verdict::wrong : Verdict::note, "multicast",
            what + ": LCM's own programs go deaf when that goes down",
            "sudo systemctl enable --now tether-host; or, until this host restarts: sudo "
            "tether-vehicle lcm-route"};
  }
  return {Verdict::wrong, "multicast",
          fmt::format("no route to {}: {}", group, m.multicast_trouble),
          fmt::format("on one host: sudo ip link set lo up && sudo ip route add {}/32 dev lo; "
                      "between hosts: the same for the interface between them",
                      group)};
}

DoctorFinding messages(const Machine& m) {
  if (!m.port_trouble.empty()) {
    return {Verdict::wrong, "messages", m.port_trouble,
            fmt::format("who has the port: sudo ss -ulpn 'sport = {}'; or choose another by "
                        "--lcm-url",
                        lcm_port(m.lcm_url))};
  }
  if (m.echo_ms) {
    return {Verdict::good, "messages",
            fmt::format("heard again on {} after {:.2f} ms", m.lcm_url, *m.echo_ms), ""};
  }
  if (m.multicast_by.empty()) {
    return {Verdict::note, "messages", "not tried without multicast", "see multicast"};
  }
  return {Verdict::wrong, "messages", fmt::format("none is heard again on {}", m.lcm_url),
          "does a firewall drop multicast? sudo nft list ruleset; sudo iptables -L -v"};
}

DoctorFinding buffers(const Machine& m) {
  if (!m.rmem_max_bytes) {
    return {Verdict::note, "buffers", "the system does not tell net.core.rmem_max", "nothing"};
  }
  const std::string what = fmt::format("net.core.rmem_max is {} bytes", *m.rmem_max_bytes);
  if (*m.rmem_max_bytes >= kLeastBuffer_bytes) return {Verdict::good, "buffers", what, ""};
  return {Verdict::note, "buffers", what + ": bursts of messages get lost",
          fmt::format("sudo sysctl -w net.core.rmem_max={} (for good: in /etc/sysctl.d)",
                      kGoodBuffer_bytes)};
}

DoctorFinding clock(const Machine& m) {
  if (!m.clock_synchronised) {
    return {Verdict::note, "clock", "not synchronised: between hosts, plans break at 0.2 s",
            fmt::format("{}; only one host needs no clock of others",
                        m.has_chrony ? "systemctl status chrony; chronyc sources"
                                     : "sudo apt install chrony")};
  }
  const std::string what =
      fmt::format("synchronised, off by at most {:.3g} ms", m.clock_error_max_ms);
  if (m.clock_error_max_ms <= kClockError_ms) return {Verdict::good, "clock", what, ""};
  return {Verdict::note, "clock", what, "chronyc tracking; a nearer time server"};
}

DoctorFinding link(const Machine& m) {
  if (m.peers.empty()) {
    return {Verdict::wrong, "link", "no LINK/REPORT on this host's LCM network",
            "systemctl status tether-link; journalctl -u tether-link"};
  }
  std::vector<std::string> all, down, apart;
  for (const auto& [name, peer] : m.peers) {
    all.push_back(name);
    if (!peer.up) down.push_back(name);
    if (peer.clocks_apart) {
      apart.push_back(
          fmt::format("{} by {:.0f} to {:.0f} ms", name, peer.offset_min_ms, peer.offset_max_ms));
    }
  }
  if (!down.empty()) {
    return {Verdict::wrong, "link", fmt::format("down: {}", fmt::join(down, ", ")),
            "journalctl -u tether-link"};
  }
  if (!apart.empty()) {
    return {Verdict::wrong, "link",
            fmt::format("clocks are ahead of ours: {}", fmt::join(apart, ", ")),
            "chronyc tracking, on both hosts"};
  }
  return {Verdict::good, "link", fmt::format("up: {}; clocks agree", fmt::join(all, ", ")), ""};
}

DoctorFinding can(const Machine& m) {
  if (m.can_asked.empty()) {
    if (m.can.empty()) return {Verdict::good, "CAN", "no interface, none was asked about", ""};
    std::vector<std::string> names;
    for (const auto& [name, state] : m.can) {
      names.push_back(fmt::format("{} is {}", name, state.up ? "up" : "down"));
    }
    return {Verdict::good, "CAN", fmt::format("{}", fmt::join(names, ", ")), ""};
  }
  const std::string& name = m.can_asked;
  const auto found = m.can.find(name);
  const bool is_virtual = name.starts_with("vcan");
  const std::string up = is_virtual
                             ? fmt::format("sudo ip link set {} up", name)
                             : fmt::format("sudo ip link set {} up type can bitrate 500000", name);
  if (found == m.can.end()) {
    return {Verdict::wrong, "CAN", fmt::format("no interface {}", name),
            is_virtual ? fmt::format("sudo ip link add dev {} type vcan && {}", name, up)
                       : "plug the adapter in; ip -details link show type can"};
  }
  if (!found->second.is_can) {
    return {Verdict::wrong, "CAN", fmt::format("{} is no CAN interface", name),
            "ip -details link show type can"};
  }
  if (!found->second.up) {
    return {Verdict::wrong, "CAN", fmt::format("{} is down", name), up};
  }
  return {Verdict::good, "CAN", fmt::format("{} is up", name), ""};
}

DoctorFinding rights(const Machine& m) {
  std::vector<std::string> lacking, limits;
  if (!m.may_be_realtime) {
    lacking.emplace_back("SCHED_FIFO");
    limits.emplace_back("LimitRTPRIO=50");
  }
  if (!m.may_lock_memory) {
    lacking.emplace_back("locked memory");
    limits.emplace_back("LimitMEMLOCK=infinity");
  }
  if (lacking.empty()) {
    return {Verdict::good, "real time", "SCHED_FIFO and locked memory are granted", ""};
  }
  return {Verdict::note, "real time", fmt::format("not granted: {}", fmt::join(lacking, ", ")),
          fmt::format("{} in a unit, or in /etc/security/limits.d", fmt::join(limits, " and "))};
}

DoctorFinding processors(const Machine& m) {
  if (m.governors.empty()) return {Verdict::good, "processors", "no frequency scaling", ""};
  std::vector<std::string> all;
  for (const auto& [name, count] : m.governors) all.push_back(fmt::format("{} {}", count, name));
  const std::string what = fmt::format("{}", fmt::join(all, ", "));
  if (m.governors.size() == 1 && m.governors.contains("performance")) {
    return {Verdict::good, "processors", what, ""};
  }
  return {Verdict::note, "processors", what + ": waking up takes longer",
          "sudo cpupower frequency-set --governor performance"};
}

DoctorFinding versions(const Machine& m) {
  const std::string all = fmt::format("Tether {}, Linux {}{}", m.version, m.kernel,
                                      m.realtime_kernel ? " (PREEMPT_RT)" : "");
  if (m.other_versions.empty()) return {Verdict::good, "versions", all, ""};
  std::vector<std::string> others;
  for (const auto& [name, version] : m.other_versions) {
    others.push_back(fmt::format("{}: {}", name, version));
  }
  return {Verdict::wrong, "versions",
          fmt::format("{}; but beside it {}", all, fmt::join(others, ", ")),
          "install all packages of one version together: sudo apt install ./tether*.deb"};
}

DoctorFinding programs(const Machine& m) {
  if (m.missing_programs.empty()) return {Verdict::good, "programs", "all are there", ""};
  static const std::map<std::string, std::string> kPackages{
      {"gnuplot", "gnuplot-nox draws figures"},
      {"ip", "iproute2 sets up interfaces"},
      {"java", "default-jre runs lcm-spy"},
      {"lcm-logplayer", "liblcm-bin replays recordings"},
      {"nft", "nftables keeps other hosts' datagrams from LCM's own programs"}};
  std::vector<std::string> remedies;
  for (const std::string& program : m.missing_programs) remedies.push_back(kPackages.at(program));
  return {Verdict::note, "programs",
          fmt::format("missing: {}", fmt::join(m.missing_programs, ", ")),
          fmt::format("sudo apt install: {}", fmt::join(remedies, ", "))};
}

const char* word_of(Verdict verdict) {
  switch (verdict) {
    case Verdict::good:
      return "ok";
    case Verdict::note:
      return "note";
    case Verdict::wrong:
      return "wrong";
  }
  return "";
}

}  // namespace

std::vector<DoctorFinding> findings_of(const Machine& machine) {
  std::vector<DoctorFinding> all{multicast(machine),  messages(machine), buffers(machine),
                                 clock(machine),      can(machine),      rights(machine),
                                 processors(machine), versions(machine), programs(machine)};
  if (machine.link_asked) all.insert(all.begin() + 4, link(machine));
  return all;
}

DoctorFinding finding_of(const Latency& latency, double cycle_ms) {
  const std::string what = fmt::format(
      "worst {:.2f} ms, 99.9 % below {:.2f} ms, of {} wake-ups in {:.0f} s under load{}, at a "
      "cycle of {:g} ms",
      latency.worst_ms, latency.p999_ms, latency.wakeups, latency.seconds,
      latency.is_realtime ? "" : " without SCHED_FIFO and locked memory", cycle_ms);
  if (latency.worst_ms <= kGoodShareOfCycle * cycle_ms) return {Verdict::good, "latency", what, ""};
  const std::string to_do =
      !latency.is_realtime ? "as root, or with LimitRTPRIO=50 and LimitMEMLOCK=infinity"
      : latency.realtime_kernel
          ? "a processor of its own: isolcpus=, and CPUAffinity= in a drop-in"
          : "a PREEMPT_RT kernel: sudo apt install linux-image-rt-amd64; or a processor "
            "of its own: isolcpus=, and CPUAffinity= in a drop-in";
  return {latency.worst_ms <= cycle_ms ? Verdict::note : Verdict::wrong, "latency", what, to_do};
}

std::string text_of(const std::vector<DoctorFinding>& findings) {
  std::string text;
  for (const DoctorFinding& f : findings) {
    text += fmt::format("{:<6} {:<11} {}\n", word_of(f.verdict), f.about, f.what);
    if (!f.to_do.empty()) text += fmt::format("{:>18} → {}\n", "", f.to_do);
  }
  return text;
}

bool is_anything_wrong(const std::vector<DoctorFinding>& findings) {
  return std::any_of(findings.begin(), findings.end(),
                     [](const auto& f) { return f.verdict == Verdict::wrong; });
}

}  // namespace tether
