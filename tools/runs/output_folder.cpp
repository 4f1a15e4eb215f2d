#include "tools/runs/output_folder.hpp"

#include <fmt/format.h>
#include <fmt/os.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <lcm/lcm-cpp.hpp>
#include <set>
#include <stdexcept>
#include <string>
#include <system_error>

#include "can_bridge/drivetrain/can_settings.hpp"
#include "common/base/errors.hpp"
#include "common/base/input_file.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/version.hpp"
#include "common/world/surroundings.hpp"
#include "controller/tube/reach_tube.hpp"
#include "netem/channel/change.hpp"
#include "netem/channel/settings.hpp"
#include "netem/models/kinds.hpp"
#include "tools/base/gnuplot.hpp"
#include "tools/base/process.hpp"
#include "tools/base/replacing_output.hpp"
#include "tools/runs/metric.hpp"

namespace tether {
namespace {

std::string channel_text(const char* name, const LinkConfig& link) {
  return fmt::format("{} {}", name, describe_model(link));
}

/// Figures are expected to come from ODE; only another plant is named in them.
std::string plant_text(const Scenario& scenario) {
  const bool is_ode = scenario.get<VehicleSettings>().plant == VehicleSettings::Plant::ode;
  return is_ode ? "" : fmt::format("{} plant; ", scenario.get<VehicleSettings>().plant_name());
}

std::string variables(const Scenario& scenario, double epsilon_m) {
  return fmt::format(
      "title_text = \"ε = {:.2f} m   ({}{}; {}; seed {})\"\n"
      "wall = {}\n",
      epsilon_m, plant_text(scenario), channel_text("up", scenario.get<ChannelSettings>().uplink),
      channel_text("down", scenario.get<ChannelSettings>().downlink),
      scenario.get<RunSettings>().seed, scenario.get<WorldSettings>().half_extent_m);
}

std::string polygon(const Shape& shape) {
  const auto at = corners(shape);
  std::string text = fmt::format("polygon from {:.3f},{:.3f}", at[3].x_m, at[3].y_m);
  for (const Position& p : at) text += fmt::format(" to {:.3f},{:.3f}", p.x_m, p.y_m);
  return text;
}

std::string object(std::size_t number, const Shape& shape, const char* style) {
  const bool round = shape.outline == Shape::Outline::circle;
  return fmt::format("set object {} {} {}\n", number,
                     round ? fmt::format("circle at {:.3f},{:.3f} size {:.3f}", shape.pose.x_m,
                                         shape.pose.y_m, shape.radius_m)
                           : polygon(shape),
                     style);
}

/// Standing obstacles, and the paths of moving ones.
std::string obstacles(const Scenario& scenario) {
  const auto& surroundings = scenario.get<Surroundings>();
  std::string text;
  std::size_t number = 1;  // 1 itself is the walls
  for (const Shape& shape : solid_shapes(surroundings)) {
    text += object(++number, shape, "fs solid 1.0 border lc rgb '#777777' fc rgb '#cccccc' behind");
  }
  MovingObstacles moving(surroundings, scenario.get<RunSettings>().seed);
  for (const Shape& shape : moving.at(0.0)) {
    text += object(++number, shape, "fs solid 1.0 noborder fc rgb '#e08a1e' front");
  }
  for (const Obstacle& obstacle : surroundings.obstacles) {
    Position from{obstacle.pose.x_m, obstacle.pose.y_m};
    for (const Position& to : obstacle.to) {
      text += fmt::format("set arrow from {},{} to {},{} nohead dt 3 lw 1.5 lc rgb '#e08a1e'\n",
                          from.x_m, from.y_m, to.x_m, to.y_m);
      from = to;
    }
  }
  return text;
}

constexpr char kOneVehicle[] = R"gnuplot(
band = tube > 0 ? "'trajectory.csv' every ::1 using 5:6:(tube) with circles fs solid noborder \
  lc rgb '#d3ecdb' title 'tube of plans', " : ''
vehicles = band . "'trajectory.csv' every ::1 using 5:6 with lines lw 4 lc rgb '#009e73' title 'planned', \
  'trajectory.csv' every ::1 using 2:3 with lines lw 2 lc rgb '#0072b2' title 'actual', \
  'trajectory.csv' every ::1::1 using 2:3 with points pt 7 ps 1.2 lc rgb '#000000' title 'start'"
)gnuplot";

constexpr char kVehicles[] = R"gnuplot(
set datafile separator ","
stats 'trajectories.csv' every ::1 using 2 nooutput
last = STATS_blocks - 1
vehicles = "for [i=0:last] 'trajectories.csv' index i every ::1 using 6:7 with lines lw 4 \
    lc rgb '#009e73' title (i == 0 ? 'planned' : ''), \
  for [i=0:last] 'trajectories.csv' index i every ::1 using 3:4 with lines lw 1.5 \
    lc rgb '#0072b2' title (i == 0 ? 'actual' : ''), \
  for [i=0:last] 'trajectories.csv' index i every ::1::1 using 3:4 with points pt 7 ps 0.9 \
    lc rgb '#000000' title (i == 0 ? 'start' : '')"
)gnuplot";

constexpr char kScript[] = R"gnuplot(
set datafile separator ","
set title title_text font ",11"
set xlabel "x [m]"
set ylabel "y [m]"
set size ratio -1
set xrange [-1.08 * wall : 1.08 * wall]
set yrange [-1.08 * wall : 1.08 * wall]
set grid lc rgb "#dddddd"
set key outside bottom center horizontal
set object 1 rectangle from -wall,-wall to wall,wall fs empty border lc rgb "#444444" lw 3

plot_lines = "plot NaN with lines lw 3 lc rgb '#444444' title 'walls', " . vehicles

set terminal svg size 720,760 font "Helvetica,12" background "white"
set output "path.svg"
eval plot_lines
set terminal pngcairo size 900,950 font "Helvetica,12"
set output "path.png"
eval plot_lines
set output
)gnuplot";

/// Draws `folder`/trajectory.csv with gnuplot to path.svg and path.png: planned path green, actual
/// path blue, walls, obstacles grey, what moves orange (its place at the start, its way dotted),
/// equal axes, ε in the title, and the plant if it is not ODE. With tube.silence_s,
/// the tube of plans is a band around the planned path (not of a fleet). The script stays beside
/// them as path.gp, to be restyled and run again. Throws if gnuplot is missing (naming the package)
/// or fails.
void draw_path_figure(const std::filesystem::path& folder, const Scenario& scenario,
                      double epsilon_m) {
  run_gnuplot(folder, "path.gp",
              variables(scenario, epsilon_m) +
                  fmt::format("tube = {}\n", tube_m(scenario).value_or(0.0)) + obstacles(scenario) +
                  kOneVehicle + kScript);
}

/// The same of `folder`/trajectories.csv, for a fleet; ε is the mean of its vehicles.
void draw_fleet_figure(const std::filesystem::path& folder, const Scenario& scenario,
                       double epsilon_m) {
  run_gnuplot(folder, "path.gp",
              variables(scenario, epsilon_m) + obstacles(scenario) + kVehicles + kScript);
}

}  // namespace
}  // namespace tether

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
