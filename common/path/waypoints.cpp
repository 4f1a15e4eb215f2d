#include "common/path/waypoints.hpp"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>

#include "common/base/csv_table.hpp"
#include "common/base/errors.hpp"
#include "common/base/input_file.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {
namespace {

constexpr double kFarthest_m = 1e5;
constexpr double kSame_m = 1e-6;
constexpr double kNearest_m = 1e-3;
constexpr double kSlowest_mps = 0.01, kFastest_mps = 100.0;
constexpr std::size_t kMost = 100'000;
constexpr double kDegree = std::numbers::pi / 180.0;
constexpr double kSharpest_rad = 135.0 * kDegree;

double coordinate(const CsvTable& table, const char* column) {
  const double value = table.number(column);
  if (std::abs(value) > kFarthest_m) table.refuse(column, "within ±100000 m");
  return value;
}

std::optional<double> wanted_speed(const CsvTable& table) {
  if (!table.has("v_mps")) return std::nullopt;
  const double v_mps = table.number("v_mps");
  if (v_mps != 0.0 && !(v_mps >= kSlowest_mps && v_mps <= kFastest_mps)) {
    table.refuse("v_mps", "in [0.01, 100]; 0 at the first and last waypoint only");
  }
  return v_mps;
}

double distance_m(const Waypoint& a, const Waypoint& b) {
  return std::hypot(b.x_m - a.x_m, b.y_m - a.y_m);
}

[[noreturn]] void fail(const Waypoints& path, const Waypoint& at, const std::string& reason) {
  throw UsageError(fmt::format("{}:{}: {}", path.file, at.line, reason));
}

void check_turn(const Waypoints& path, const Waypoint& a, const Waypoint& b, const Waypoint& c) {
  const double turn = wrap_angle(std::atan2(c.y_m - b.y_m, c.x_m - b.x_m) -
                                 std::atan2(b.y_m - a.y_m, b.x_m - a.x_m));
  if (std::abs(turn) <= kSharpest_rad) return;
  fail(path, b,
       fmt::format("the path turns back by {:.0f}° at this waypoint: must be at most 135° from one "
                   "waypoint to the next (the vehicle drives no cusps; describe the turn by more "
                   "waypoints)",
                   std::abs(turn) / kDegree));
}

void check(const Waypoints& path) {
  const auto& p = path.points;
  const std::size_t least = path.is_closed() ? 4 : 2;
  if (p.size() < least) {
    fail(
        path, p.back(),
        fmt::format("{} waypoint{}: a path needs at least {}{}", p.size(), p.size() == 1 ? "" : "s",
                    least, path.is_closed() ? " where the last is the first, as here" : ""));
  }
  for (std::size_t i = 1; i + 1 < p.size(); ++i) {
    if (p[i].v_mps == 0.0) {
      fail(path, p[i],
           "v_mps = \"0\" must be in [0.01, 100]; 0 at the first and last waypoint only");
    }
    check_turn(path, p[i - 1], p[i], p[i + 1]);
  }
  if (path.is_closed()) check_turn(path, p[p.size() - 2], p[0], p[1]);
}

}  // namespace

bool Waypoints::is_closed() const {
  return points.size() > 2 && distance_m(points.front(), points.back()) <= kSame_m;
}

Waypoints read_waypoints(std::istream& in, const std::string& name) {
  CsvTable table(in, name);
  for (const char* column : {"x_m", "y_m"}) {
    if (!table.has(column)) table.fail(fmt::format("the header must name a column {}", column));
  }
  Waypoints path{name, {}};
  while (table.next_row()) {
    const Waypoint point{coordinate(table, "x_m"), coordinate(table, "y_m"), wanted_speed(table),
                         table.line_number()};
    if (!path.points.empty() && distance_m(path.points.back(), point) < kNearest_m) {
      table.fail(fmt::format("the waypoint is the same as that of line {}, to less than 1 mm",
                             path.points.back().line));
    }
    if (path.points.size() == kMost) table.fail(fmt::format("more than {} waypoints", kMost));
    path.points.push_back(point);
  }
  if (path.points.empty()) table.fail("no waypoints below the header");
  check(path);
  return path;
}

Waypoints load_waypoints(const std::string& file) {
  std::ifstream in = open_input(file, "the waypoints", kMostTableBytes);
  return read_waypoints(in, file);
}

}  // namespace tether
