#include "tools/runs/output_folder.hpp"

#include <fmt/format.h>
#include <fmt/os.h>

#include <cerrno>
#include <cstdio>
#include <fstream>
#include <lcm/lcm-cpp.hpp>
#include <set>
#include <stdexcept>
#include <system_error>

#include "can_bridge/drivetrain/can_settings.hpp"
#include "common/base/errors.hpp"
#include "common/base/input_file.hpp"
#include "common/path/path_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/version.hpp"
#include "netem/channel/change.hpp"
#include "netem/channel/settings.hpp"
#include "tools/base/process.hpp"
#include "tools/base/write_file.hpp"
#include "tools/runs/metric.hpp"
#include "tools/runs/path_figure.hpp"

namespace fs = std::filesystem;

namespace tether {
namespace {

constexpr Duration kFlushPeriod = std::chrono::milliseconds{500};
constexpr std::uintmax_t kEventHeaderBytes = 28;  // sync, number, time stamp, two lengths

/// First words of a scenario.toml that OutputFolder wrote.
const std::string kScenarioHeader = "# Resolved scenario, tether ";

void check_nothing_foreign(const fs::path& folder) {
  static const std::set<std::string> kOurs{"scenario.toml",    "summary.json",  "trajectory.csv",
                                           "trajectories.csv", "run.lcmlog",    "path.gp",
                                           "path.svg",         "path.png",      "drivetrain.toml",
                                           "path.csv",         "incomplete.txt"};
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    std::string name = entry.path().filename().string();
    std::string first_line;
    if (name == "scenario.toml" && entry.is_regular_file())
      std::getline(std::ifstream(entry.path()) >> std::ws, first_line);
    if (name.ends_with(kUnfinished)) name.resize(name.size() - kUnfinished.size());
    const bool written_by_hand =
        name == "scenario.toml" && !first_line.starts_with(kScenarioHeader);
    const bool no_run = !fs::exists(folder / "scenario.toml");
    if (!kOurs.contains(name) || written_by_hand || no_run) {
      throw UsageError(
          fmt::format("--out: \"{}\" holds \"{}\", which is not an earlier run's; name a new or "
                      "empty folder",
                      folder.string(), name));
    }
  }
}

/// The scenario with its drivetrain's file copied into `folder`.
Scenario with_drivetrain_beside(Scenario scenario, const fs::path& folder) {
  if (scenario.get<VehicleSettings>().drivetrain != VehicleSettings::Drivetrain::can)
    return scenario;
  write_file(folder / "drivetrain.toml", read_input(scenario.get<CanSettings>().drivetrain_file,
                                                    "the drivetrain file", kMostTomlBytes));
  scenario.get<CanSettings>().drivetrain_file = "drivetrain.toml";
  return scenario;
}

/// The scenario with its waypoints copied into `folder`.
Scenario with_waypoints_beside(Scenario scenario, const fs::path& folder) {
  if (scenario.get<PathSettings>().kind != "csv") return scenario;
  write_file(folder / "path.csv",
             read_input(scenario.get<PathSettings>().csv, "the waypoints", kMostTableBytes));
  scenario.get<PathSettings>().csv = "path.csv";
  return scenario;
}

constexpr const char* kColumns =
    "t_s,x_m,y_m,yaw_rad,x_ref_m,y_ref_m,error_m,uplink_state,downlink_state";

/// `begin`: of each row.
std::string csv_rows(const std::vector<TrajectoryRow>& rows, const std::string& begin = "") {
  std::string text;
  for (const TrajectoryRow& r : rows) {
    text += begin;
    text += fmt::format("{:.6f},{},{},{},{},{},{},{},{}\n", r.t_s, r.x_m, r.y_m, r.yaw_rad,
                        r.x_ref_m, r.y_ref_m, r.error_m, r.uplink_state, r.downlink_state);
  }
  return text;
}

}  // namespace

Scenario with_absolute_names(Scenario scenario) {
  for (const ScenarioKey& key : scenario.schema().keys_of(scenario)) {
    if (!key.file) continue;
    std::string& file = key.file(scenario);
    if (!file.empty()) file = fs::absolute(file).string();
  }
  for (ChannelSettings::Change& change : scenario.get<ChannelSettings>().changes) {
    for (std::string& text : change.settings) text = setting_in_folder(text, fs::current_path());
  }
  return scenario;
}

EventLogWriter::EventLogWriter(const fs::path& file, EventLoop& loop, Bus& bus)
    : file_(file), loop_(loop), log_(std::make_unique<lcm::LogFile>(file.string(), "w")) {
  if (!log_->good()) throw UsageError(fmt::format("cannot write \"{}\"", file.string()));
  bus.subscribe(".*", kDeepQueue, [this](const Message& message) { write(message); });
}

EventLogWriter::~EventLogWriter() = default;

void EventLogWriter::write(const Message& message) {
  if (!log_) return;
  lcm::LogEvent event{};
  event.eventnum = events_++;
  event.timestamp = to_utime(loop_.now());
  event.channel = std::string(message.channel);
  event.datalen = static_cast<std::int32_t>(message.bytes.size());
  // LCM's signature lacks a const; it only reads.
  event.data = const_cast<std::uint8_t*>(message.bytes.data());
  errno = 0;
  if (log_->writeEvent(&event) != 0) return fail();
  bytes_ += kEventHeaderBytes + message.channel.size() + message.bytes.size();
  if (loop_.now() < next_flush_) return;
  next_flush_ = loop_.now() + kFlushPeriod;  // a full disk shows only then
  if (std::fflush(log_->getFilePtr()) != 0) fail();
}

/// Says at once why, and takes no more: after a gap, later data could not be distinguished from
/// complete data.
void EventLogWriter::fail() {
  failure_ = fmt::format("cannot write \"{}\": {}", file_.string(),
                         std::generic_category().message(errno));
  fmt::print(stderr, "tether: {}; its recording ends here, the run goes on\n", failure_);
  log_.reset();
}

void EventLogWriter::close() {
  if (log_ && std::fflush(log_->getFilePtr()) != 0) fail();
  if (!failure_.empty()) throw std::runtime_error(failure_ + "; it is incomplete");
  if (!log_) return;
  log_.reset();
  std::error_code error;
  // LCM does not say whether its last buffer reached the disk; the size does.
  if (fs::file_size(file_, error) != bytes_) {
    throw std::runtime_error(fmt::format("\"{}\" is incomplete", file_.string()));
  }
}

OutputFolder::OutputFolder(const fs::path& folder, const Scenario& scenario) : folder_(folder) {
  if (find_program("gnuplot").empty()) {
    throw std::runtime_error("--out draws with gnuplot, which is missing: apt install gnuplot-nox");
  }
  std::error_code error;
  fs::create_directories(folder_, error);
  if (error || !fs::is_directory(folder_)) {
    throw UsageError(fmt::format("--out: cannot create the folder \"{}\": {}", folder_.string(),
                                 error ? error.message() : "a file of that name is in the way"));
  }
  check_nothing_foreign(folder_);
  const Scenario resolved = with_waypoints_beside(
      with_drivetrain_beside(with_absolute_names(scenario), folder_), folder_);
  write_file(folder_ / "scenario.toml",
             kScenarioHeader + std::string(kVersion) + "\n\n" + to_toml(resolved));
  // Not before there is room for another run's: on a full disk the earlier results stay.
  for (const char* name : {"summary.json", "trajectory.csv", "trajectories.csv"}) {
    fs::remove(folder_ / name, error);
  }
  fs::remove(folder_ / "incomplete.txt", error);
}

void OutputFolder::record(EventLoop& loop, Bus& bus) {
  log_ = std::make_unique<EventLogWriter>(folder_ / "run.lcmlog", loop, bus);
}

void OutputFolder::write_trajectories(const FleetObserver& run) {
  if (run.is_one()) {
    write_file(folder_ / "trajectory.csv",
               fmt::format("{}\n{}", kColumns, csv_rows(run.first().trajectory())));
    return;
  }
  std::string text;  // blocks as gnuplot takes them, two empty lines apart
  for (std::size_t i = 0; i < run.vehicles().size(); ++i) {
    text += fmt::format("{}vehicle,{}\n{}", i > 0 ? "\n\n" : "", kColumns,
                        csv_rows(run.vehicles()[i]->trajectory(), run.names()[i] + ","));
  }
  write_file(folder_ / "trajectories.csv", text);
}

void OutputFolder::write(const Scenario& scenario, const FleetObserver& run,
                         const std::string& summary_json) {
  write_trajectories(run);
  if (log_) log_->close();
  if (run.is_one()) {
    draw_path_figure(folder_, scenario, run.first().truth().epsilon_m);
  } else {
    draw_fleet_figure(folder_, scenario,
                      value_of(metrics()[*metric_number("epsilon_m")], run.vehicles(), kStart));
  }
  write_file(folder_ / "summary.json", summary_json + "\n");
}

void OutputFolder::write_incomplete(const FleetObserver& run, const std::string& why) {
  write_file(folder_ / "incomplete.txt", "This run broke off: " + why + "\n");
  write_trajectories(run);
  if (log_) log_->close();
}

}  // namespace tether
