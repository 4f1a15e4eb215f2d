#include "tools/doctor/findings.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <net/if_arp.h>
#include <poll.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/timex.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <stdexcept>
#include <string_view>
#include <system_error>
#include <tether/peer_report_t.hpp>

#include "common/base/share.hpp"
#include "common/base/text.hpp"
#include "common/lcm/host_routes.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/lcm/udp_sockets.hpp"
#include "common/lcm/udpm_bus.hpp"
#include "common/node/message_io.hpp"
#include "common/node/real_time_loop.hpp"
#include "common/version.hpp"
#include "tools/base/process.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;
constexpr auto kPatience = std::chrono::milliseconds{300};
constexpr char kChannel[] = "TETHER/DOCTOR";

/// The first word of a file of the kernel's; empty if there is none.
std::string word_in(const fs::path& file) {
  std::string word;
  std::ifstream(file) >> word;
  return word;
}

bool is_radio(const std::string& interface) {
  const fs::path folder = fs::path("/sys/class/net") / interface;
  if (fs::exists(folder / "wireless") || fs::exists(folder / "phy80211")) return true;
  std::ifstream events(folder / "uevent");
  for (std::string line; std::getline(events, line);) {
    if (line == "DEVTYPE=wlan" || line == "DEVTYPE=wwan") return true;
  }
  return false;
}

/// A socket that is connected to the group has the address by which it would send.
void find_route(Machine& machine) {
  const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  const sockaddr_in group = udpm_address(machine.lcm_url);
  sockaddr_in own{};
  socklen_t size = sizeof own;
  if (connect(fd, reinterpret_cast<const sockaddr*>(&group), sizeof group) != 0) {
    machine.multicast_trouble = std::generic_category().message(errno);
  } else if (getsockname(fd, reinterpret_cast<sockaddr*>(&own), &size) == 0) {
    machine.multicast_by = inet_ntoa(own.sin_addr);
    machine.multicast_interface = outgoing_interface(group.sin_addr);
    machine.multicast_by_radio = is_radio(machine.multicast_interface);
  }
  close(fd);
}

/// Whether one of our messages is heard on `fd` in time.
bool is_heard(int fd, std::chrono::steady_clock::time_point deadline) {
  std::array<char, 65536> datagram{};
  for (;;) {
    const auto left =
        std::chrono::ceil<std::chrono::milliseconds>(deadline - std::chrono::steady_clock::now());
    pollfd waiting{fd, POLLIN, 0};
    if (left.count() <= 0 || poll(&waiting, 1, static_cast<int>(left.count())) <= 0) return false;
    const ssize_t bytes = recv(fd, datagram.data(), datagram.size(), MSG_DONTWAIT);
    if (bytes <= 0) continue;
    const std::string_view text(datagram.data(), static_cast<std::size_t>(bytes));
    if (text.find(kChannel) != std::string_view::npos) return true;
  }
}

void send_and_hear(Machine& machine) {
  int fd = -1;
  try {
    fd = open_udpm_receiver(machine.lcm_url);
  } catch (const std::exception& error) {
    machine.port_trouble = error.what();
    return;
  }
  if (!machine.multicast_by.empty()) {
    RealTimeLoop loop(RealTimeLoop::wall_utime_us());
    UdpmBus bus(machine.lcm_url, loop);
    const auto start = std::chrono::steady_clock::now();
    bus.publish(kChannel, {});
    if (is_heard(fd, start + kPatience)) {
      machine.echo_ms =
          std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
              .count();
    }
  }
  close(fd);
}

/// Peers report at the same time, once in report_period_s, 1 s if it is not set.
void hear_of_peers(Machine& machine) {
  constexpr Duration kReport = std::chrono::milliseconds{1500};
  RealTimeLoop loop(RealTimeLoop::wall_utime_us());
  UdpmBus bus(machine.lcm_url, loop);
  std::int64_t undecodable = 0;
  subscribe<peer_report_t>(
      bus, "LINK/REPORT", kDeepQueue, undecodable, [&machine](const peer_report_t& r) {
        machine.peers[r.peer] = {r.up != 0, r.clocks_apart != 0, r.offset_min_ms, r.offset_max_ms};
      });
  loop.run_until(loop.now() + kReport);
}

void look_at_clock(Machine& machine) {
  timex now{};
  const int state = adjtimex(&now);
  machine.clock_synchronised = state != -1 && state != TIME_ERROR;
  machine.clock_error_max_ms = static_cast<double>(now.maxerror) * 1e-3;
}

void look_at_can(Machine& machine) {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator("/sys/class/net", error)) {
    const std::string name = entry.path().filename();
    const bool is_can = word_in(entry.path() / "type") == std::to_string(ARPHRD_CAN);
    const bool up = (std::strtol(word_in(entry.path() / "flags").c_str(), nullptr, 16) & 1) != 0;
    if (is_can || name == machine.can_asked) machine.can[name] = {is_can, up};
  }
}

/// Asks for both, and gives them back.
void look_at_rights(Machine& machine) {
  const sched_param usual{}, urgent{.sched_priority = 1};
  machine.may_be_realtime = sched_setscheduler(0, SCHED_FIFO, &urgent) == 0;
  if (machine.may_be_realtime) sched_setscheduler(0, SCHED_OTHER, &usual);
  machine.may_lock_memory = mlockall(MCL_CURRENT | MCL_FUTURE) == 0;
  if (machine.may_lock_memory) munlockall();
}

void look_at_processors(Machine& machine) {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator("/sys/devices/system/cpu", error)) {
    const std::string governor = word_in(entry.path() / "cpufreq/scaling_governor");
    if (!governor.empty()) ++machine.governors[governor];
  }
}

/// Version that a program reports; empty if nothing.
std::string version_of(const fs::path& program) {
  const std::string name = program.filename();
  const std::unique_ptr<FILE, int (*)(FILE*)> said(
      popen(("'" + program.string() + "' --version 2>/dev/null").c_str(), "re"), pclose);
  std::array<char, 200> line{};
  if (!said || std::fgets(line.data(), line.size(), said.get()) == nullptr) return {};
  std::string text(
      trimmed(std::string_view(line.data()).substr(0, std::strcspn(line.data(), "\n"))));
  return text.starts_with(name + " ") ? text.substr(name.size() + 1) : text;
}

void look_at_siblings(Machine& machine) {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(executable_folder(), error)) {
    const std::string name = entry.path().filename();
    const bool is_ours = name == "tether" || name.starts_with("tether-");
    if (!is_ours || access(entry.path().c_str(), X_OK) != 0) continue;
    const std::string version = version_of(entry.path());
    if (version != machine.version) machine.other_versions[name] = version;
  }
}

}  // namespace

Machine examine(const std::string& lcm_url, const std::string& can_interface, bool link) {
  Machine machine;
  machine.lcm_url = checked_lcm_url(lcm_url);
  machine.can_asked = can_interface;
  machine.version = kVersion;
  look_at_siblings(machine);
  utsname system{};
  if (uname(&system) == 0) machine.kernel = system.release;
  machine.realtime_kernel = word_in("/sys/kernel/realtime") == "1";
  if (!multicast_group(machine.lcm_url).empty()) {
    find_route(machine);
    send_and_hear(machine);
    machine.link_asked = link;
    if (link && machine.port_trouble.empty() && !machine.multicast_by.empty())
      hear_of_peers(machine);
  }
  const std::string rmem_max = word_in("/proc/sys/net/core/rmem_max");
  if (!rmem_max.empty()) machine.rmem_max_bytes = std::stoll(rmem_max);
  look_at_clock(machine);
  look_at_can(machine);
  look_at_rights(machine);
  look_at_processors(machine);
  std::vector<const char*> programs{"ip", "nft"};
  if (fs::exists(executable_folder() / "tether")) {  // not a vehicle's computer
    programs = {"ip", "gnuplot", "java", "lcm-logplayer"};
  }
  const auto is_there = [](const char* program) {  // /usr/sbin is not on every user's PATH
    return !find_program(program).empty() || fs::exists(fs::path("/usr/sbin") / program);
  };
  machine.has_chrony = is_there("chronyd");
  for (const char* program : programs) {
    if (!is_there(program)) machine.missing_programs.emplace_back(program);
  }
  return machine;
}

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
