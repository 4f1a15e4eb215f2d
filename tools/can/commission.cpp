#include "tools/can/commission.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <stdexcept>

#include "can_bridge/bus/socket_can_port.hpp"
#include "can_bridge/commission/commission.hpp"
#include "can_bridge/drivetrain/can_settings.hpp"
#include "can_bridge/drivetrain/state_folder.hpp"
#include "can_bridge/profiles/profiles.hpp"
#include "can_bridge/safety/transmit_whitelist.hpp"
#include "common/base/errors.hpp"
#include "common/base/share.hpp"
#include "common/node/real_time_loop.hpp"
#include "common/program/cli.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;

Cia402Config drives_of(const Scenario& scenario) {
  if (scenario.get<VehicleSettings>().drivetrain != VehicleSettings::Drivetrain::can) {
    throw UsageError("the scenario has no CAN drivetrain: set vehicle.drivetrain = \"can\"");
  }
  const std::string& file = scenario.get<CanSettings>().drivetrain_file;
  const DrivetrainConfig config = load_drivetrain(file);
  const auto* const drives = std::get_if<Cia402Config>(&config);
  if (drives == nullptr) {
    throw UsageError(fmt::format("{}: only CiA 402 drives are commissioned", file));
  }
  check_cycle(config, scenario.get<CanSettings>().cycle_ms);
  check_deceleration(config, scenario.get<CanSettings>().max_deceleration_mps2,
                     scenario.get<VehicleSettings>().wheel_radius_m);
  return *drives;
}

Commission::Options options_of(const CanCommissionOptions& options, const CanSettings& can) {
  const double most =
      options.wheels_free ? Commission::kMostSpeedFree_mps : Commission::kMostSpeedOnFloor_mps;
  if (options.speed_mps > most) {
    throw UsageError(fmt::format("--speed-mps {}: must be at most {} with {}", options.speed_mps,
                                 most, options.wheels_free ? "--wheels-free" : "--on-the-floor"));
  }
  return {options.wheels_free, options.speed_mps > 0.0 ? options.speed_mps : most,
          from_seconds(can.cycle_ms * 1e-3)};
}

/// Drives the loop until the drives are stopped, whatever signals come.
void run(Commission& commission, SocketCanPort& port, RealTimeLoop& loop,
         TransmitWhitelist whitelist, Duration cycle) {
  port.on_frame(commission.filters(),
                [&](const CanFrame& frame) { commission.on_frame(frame, loop.now()); });
  std::vector<CanFrame> out;
  std::string shown;
  loop.every(loop.now(), cycle, Priority::node, [&](Instant) {
    out.clear();
    commission.tick(loop.now(), out);
    for (CanFrame& frame : out) {
      if (whitelist.pass(frame, commission.may_move())) port.send(frame);
    }
    if (const std::string now = commission.progress(); now != shown) {
      fmt::print("{}\n", now);
      std::fflush(stdout);
      shown = now;
    }
    if (commission.done()) loop.stop();
  });
  loop.run();
  if (commission.done()) return;
  commission.abort();
  while (!commission.done()) loop.run_until(loop.now() + cycle);
}

void print(const CommissionRecord& record) {
  for (const CommissionRecord::Result& result : record.results) {
    fmt::print("{:<24} {:<20} {}\n", result.drive, result.trial, result.found);
    if (!result.problem.empty()) fmt::print("{:<24} PROBLEM: {}\n", "", result.problem);
  }
}

/// Whole or not at all: a record that is cut off could pass for one with fewer trials.
void write(const fs::path& file, const std::string& text) {
  std::error_code error;
  if (file.has_parent_path()) fs::create_directories(file.parent_path(), error);
  const fs::path begun = file.string() + ".begun";
  std::ofstream out(begun, std::ios::binary);
  out << text;
  out.close();
  if (out) fs::rename(begun, file, error);
  if (!out || error) {
    fs::remove(begun, error);
    throw std::runtime_error(fmt::format("cannot write the record \"{}\"", file.string()));
  }
}

}  // namespace

int can_commission(const CanCommissionOptions& options) {
  const Scenario scenario = load_scenario(input_named(options.scenario_file), options.overrides);
  const auto& can = scenario.get<CanSettings>();
  const auto& vehicle = scenario.get<VehicleSettings>();
  const Cia402Config drives = drives_of(scenario);
  const Commission::Options trials = options_of(options, can);
  fs::path file = options.record_file;
  if (file.empty()) file = can.commission_record;
  if (file.empty()) file = default_commission_record(vehicle.name, can.interface);

  RealTimeLoop loop(RealTimeLoop::wall_utime_us());
  SocketCanPort port(can.interface, loop);
  if (port.state() == CanState::down) {
    throw std::runtime_error(
        fmt::format("{} is down: bring it up (ip link set … up)", can.interface));
  }
  Commission commission(drives, vehicle, trials, loop.now());
  run(commission, port, loop, TransmitWhitelist(drives.transmit_rules()), trials.cycle);

  CommissionRecord record = commission.record();
  record.vehicle = vehicle.name;
  record.interface = can.interface;
  record.operator_name = options.operator_name;
  record.date = fmt::format(
      "{:%FT%TZ}",
      fmt::gmtime(std::chrono::system_clock::to_time_t(std::chrono::system_clock::now())));
  fmt::print("\n");
  print(record);
  // A trial that failed also takes the place of an older record; one that was not finished does
  // not.
  const bool found_trouble = !record.results.empty() && !record.passed();
  if (commission.failure().empty() || found_trouble) write(file, to_toml(record));
  if (!commission.failure().empty()) {
    throw std::runtime_error("not commissioned: " + commission.failure());
  }
  fmt::print("\n{}: {}\n", record.passed() ? "commissioned" : "NOT commissioned: see PROBLEM above",
             file.string());
  return record.passed() ? kExitOk : kExitFailed;
}

}  // namespace tether
