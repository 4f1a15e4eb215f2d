#include "tools/doctor/machine.hpp"

#include <arpa/inet.h>
#include <net/if_arp.h>
#include <poll.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/timex.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <stdexcept>
#include <string_view>
#include <system_error>
#include <tether/peer_report_t.hpp>

#include "common/base/share.hpp"
#include "common/base/text.hpp"
#include "common/bus/message_io.hpp"
#include "common/lcm/host_routes.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/lcm/udp_sockets.hpp"
#include "common/lcm/udpm_bus.hpp"
#include "common/loop/real_time_loop.hpp"
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

}  // namespace tether
