#include "tools/can/probe.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cstdint>
#include <optional>
#include <set>
#include <stdexcept>

#include "can_bridge/bus/socket_can_port.hpp"
#include "can_bridge/drivetrain/can_settings.hpp"
#include "can_bridge/probe/probe.hpp"
#include "can_bridge/profiles/profiles.hpp"
#include "common/base/errors.hpp"
#include "common/base/share.hpp"
#include "common/node/real_time_loop.hpp"
#include "common/program/cli.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {
namespace {

constexpr Duration kTick = std::chrono::milliseconds{2};

/// Refuses what the bridge would: ramps that are weaker than the vehicle's stops, too.
std::optional<Cia402Config> load(const CanProbeOptions& options) {
  const Scenario scenario = options.scenario_file.empty()
                                ? Scenario()
                                : load_scenario(input_named(options.scenario_file), {});
  const auto& can = scenario.get<CanSettings>();
  const std::string file =
      options.drivetrain_file.empty() ? can.drivetrain_file : options.drivetrain_file;
  if (file.empty()) return std::nullopt;
  const DrivetrainConfig config = load_drivetrain(input_named(file));
  const auto* const drives = std::get_if<Cia402Config>(&config);
  if (drives == nullptr) {
    throw UsageError(fmt::format(
        "{}: only CiA 402 drives have objects to read; listen to this one with candump", file));
  }
  check_deceleration(config, can.max_deceleration_mps2,
                     scenario.get<VehicleSettings>().wheel_radius_m);
  return *drives;
}

std::vector<std::uint8_t> chosen_nodes(const CanProbeOptions& options,
                                       const std::optional<Cia402Config>& config) {
  std::vector<std::uint8_t> nodes;
  const auto add = [&nodes](int node) {
    const auto id = static_cast<std::uint8_t>(node);
    if (std::find(nodes.begin(), nodes.end(), id) == nodes.end()) nodes.push_back(id);
  };
  for (const int node : options.nodes) add(node);
  if (nodes.empty() && config) {
    for (const std::uint8_t node : config->nodes()) add(node);
  }
  if (nodes.empty()) {
    throw UsageError(
        "whom to probe? Give --node or --drivetrain; --scan finds out who is on the bus");
  }
  return nodes;
}

void check_usable(const SocketCanPort& port, const std::string& interface) {
  if (port.state() == CanState::down) {
    throw std::runtime_error(fmt::format(
        "{0} is down: sudo ip link set {0} up type can bitrate 500000 (a virtual bus: sudo ip link "
        "set {0} up)",
        interface));
  }
}

bool has_answered(const ProbedNode& node) { return node.answered; }

}  // namespace

int can_probe(const CanProbeOptions& options) {
  const std::optional<Cia402Config> config = load(options);
  std::vector<std::uint8_t> nodes;
  if (!options.scan) nodes = chosen_nodes(options, config);
  RealTimeLoop loop(RealTimeLoop::wall_utime_us());
  SocketCanPort port(options.interface, loop);
  check_usable(port, options.interface);

  Probe probe = options.scan ? Probe::scan(loop.now())
                             : Probe(nodes, config ? &*config : nullptr, loop.now());
  Probe* current = &probe;
  port.on_frame(Probe::filters(),
                [&](const CanFrame& frame) { current->on_frame(frame, loop.now()); });
  std::vector<CanFrame> out;
  loop.every(loop.now(), kTick, Priority::node, [&](Instant) {
    out.clear();
    current->tick(loop.now(), out);
    for (const CanFrame& frame : out) {
      assert(is_upload_request(frame));  // nothing else may leave, whatever Probe does
      port.send(frame);
    }
    if (current->done(loop.now())) loop.stop();
  });
  const auto run = [&loop] {
    loop.run();
    if (loop.signal() != 0) throw std::runtime_error("interrupted");
  };
  run();

  const std::vector<ProbedNode> report = probe.report();
  std::set<int> heard = probe.heard();
  std::string others;
  if (!options.scan && !std::all_of(report.begin(), report.end(), has_answered)) {
    Probe scan = Probe::scan(loop.now());
    current = &scan;
    run();
    heard.insert(scan.heard().begin(), scan.heard().end());
    const std::vector<ProbedNode> all = scan.report();
    if (std::any_of(all.begin(), all.end(), has_answered)) {
      others = "\nWho is on this bus:\n" + format_scan(all, heard);
    }
  }
  fmt::print("{}{}",
             options.scan ? format_scan(report, heard)
                          : format_probe(report, heard, config ? config->name : ""),
             others);
  if (port.state() != CanState::up) {
    fmt::print("\n{} is {}\n", options.interface, to_string(port.state()));
  }
  const auto is_fit = [](const ProbedNode& n) { return n.fits(); };
  const bool fits = options.scan ? std::any_of(report.begin(), report.end(), is_fit)
                                 : std::all_of(report.begin(), report.end(), is_fit);
  return fits ? kExitOk : kExitFailed;
}

}  // namespace tether
