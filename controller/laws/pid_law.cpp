#include "controller/laws/pid_law.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <set>
#include <utility>

#include "common/base/csv_table.hpp"
#include "common/base/errors.hpp"
#include "common/path/controlled_point.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {

double Pid::step(double error, double dt_s) {
  if (!state_.started) {
    dt_s = 0.0;  // the time before the first step does not count
    state_ = {};
    state_.started = true;
    state_.filtered_error = error;
  } else if (dt_s > 0.0) {
    double difference = error - state_.filtered_error;
    if (config_.angular) difference = wrap_angle(difference);
    const double change = difference * dt_s / (config_.derivative_filter_s + dt_s);
    state_.filtered_error += change;
    if (config_.angular) state_.filtered_error = wrap_angle(state_.filtered_error);
    state_.derivative = change / dt_s;
  }

  const double candidate = state_.integral + config_.i * error * dt_s;
  const double output = config_.p * error + candidate + config_.d * state_.derivative;
  const bool winds_up = std::abs(output) > config_.limit && output * error > 0.0;
  if (!winds_up) state_.integral = candidate;
  return std::clamp(config_.p * error + state_.integral + config_.d * state_.derivative,
                    -config_.limit, config_.limit);
}

namespace {

struct Mean {
  double sum = 0.0;
  int count = 0;
};
/// For each PRR and delay: ε by τ.
using Cells = std::map<std::pair<double, double>, std::map<double, Mean>>;

Cells read_cells(std::istream& in, const std::string& name) {
  CsvTable table(in, name);
  for (const char* column : {"channel.prr", "controller.tau_s", "epsilon_m"}) {
    if (table.has(column)) continue;
    throw UsageError(fmt::format(
        "{}: has no column {}; a table of look-aheads needs channel.prr, controller.tau_s and "
        "epsilon_m, and may have channel.delay_ms",
        name, column));
  }
  const bool has_delay = table.has("channel.delay_ms");
  Cells cells;
  while (table.next_row()) {
    const double prr = table.number("channel.prr");
    const double delay_ms = has_delay ? table.number("channel.delay_ms") : 0.0;
    const double tau_s = table.number("controller.tau_s");
    if (prr < 0.0 || prr > 1.0) table.refuse("channel.prr", "in [0, 1]");
    if (delay_ms < 0.0) table.refuse("channel.delay_ms", "0 or more");
    if (tau_s < 0.0 || tau_s > 1e6) table.refuse("controller.tau_s", "in [0, 1e6]");
    if (table.cell("epsilon_m").empty()) continue;
    Mean& mean = cells[{prr, delay_ms}][tau_s];
    mean.sum += table.number("epsilon_m");
    ++mean.count;
  }
  return cells;
}

double best_tau_s(const std::map<double, Mean>& candidates) {
  const auto value = [](const auto& entry) { return entry.second.sum / entry.second.count; };
  return std::min_element(candidates.begin(), candidates.end(),
                          [&](const auto& a, const auto& b) { return value(a) < value(b); })
      ->first;
}

/// Where `x` lies in an ascending list: between [index] and the next, by a share in [0, 1].
std::pair<std::size_t, double> place_in(const std::vector<double>& list, double x) {
  if (list.size() == 1 || x <= list.front()) return {0, 0.0};
  if (x >= list.back()) return {list.size() - 2, 1.0};
  const auto above = std::upper_bound(list.begin(), list.end(), x);
  const auto index = static_cast<std::size_t>(std::distance(list.begin(), above)) - 1;
  return {index, (x - list[index]) / (list[index + 1] - list[index])};
}

}  // namespace

TauTable TauTable::read(std::istream& in, const std::string& name) {
  const Cells cells = read_cells(in, name);
  if (cells.empty()) throw UsageError(fmt::format("{}: has no look-ahead with an error", name));
  std::set<double> prrs, delays;
  for (const auto& [where, unused] : cells) {
    prrs.insert(where.first);
    delays.insert(where.second);
  }
  TauTable table;
  table.prrs_.assign(prrs.begin(), prrs.end());
  table.delays_ms_.assign(delays.begin(), delays.end());
  for (const double prr : table.prrs_) {
    for (const double delay_ms : table.delays_ms_) {
      const auto cell = cells.find({prr, delay_ms});
      if (cell == cells.end()) {
        throw UsageError(
            fmt::format("{}: has nothing for channel.prr = {} and channel.delay_ms = {}: all "
                        "combinations are needed",
                        name, prr, delay_ms));
      }
      table.tau_s_.push_back(best_tau_s(cell->second));
    }
  }
  return table;
}

double TauTable::tau_s(double prr, double delay_ms) const {
  const auto [i, prr_share] = place_in(prrs_, prr);
  const auto [j, delay_share] = place_in(delays_ms_, delay_ms);
  const auto along_delay = [&, j = j, share = delay_share](std::size_t row) {
    return share == 0.0 ? at(row, j) : (1.0 - share) * at(row, j) + share * at(row, j + 1);
  };
  const double low = along_delay(i);
  return prr_share == 0.0 ? low : (1.0 - prr_share) * low + prr_share * along_delay(i + 1);
}

namespace {

Pid make_pid(const PidGains& gains, double derivative_filter_s, bool angular) {
  return Pid({gains.p, gains.i, gains.d, gains.limit, derivative_filter_s, angular});
}

}  // namespace

PidLaw::PidLaw(const ControllerSettings& config, std::shared_ptr<const ReferencePath> path,
               double ahead_m)
    : path_(std::move(path)),
      ahead_m_(ahead_m),
      tau_s_(config.tau_s),
      wrap_heading_(config.wrap_heading),
      v_(make_pid(config.v, config.derivative_filter_s, false)),
      omega_(make_pid(config.omega, config.derivative_filter_s, config.wrap_heading)) {}

Twist PidLaw::step(const Pose2& pose, Instant now) {
  const PathPoint target = path_->at(to_seconds(now) + tau_s_);
  const Position point = point_ahead(pose, ahead_m_);
  const double dx_m = target.x_m - point.x_m;
  const double dy_m = target.y_m - point.y_m;
  errors_.heading_rad = std::atan2(dy_m, dx_m) - pose.yaw_rad;
  if (wrap_heading_) errors_.heading_rad = wrap_angle(errors_.heading_rad);
  errors_.distance_m = std::hypot(dx_m, dy_m);

  const double dt_s = to_seconds(now - last_);
  last_ = now;
  return {v_.step(errors_.distance_m, dt_s), omega_.step(errors_.heading_rad, dt_s)};
}

void PidLaw::reset() {
  v_.reset();
  omega_.reset();
}

LawKind pid_law() {
  return {.name = "pid",
          .steers_any_point = true,
          .looks_ahead = true,
          .keys = {},
          .make = [](const LawContext& context) -> std::unique_ptr<Law> {
            return std::make_unique<PidLaw>(context.settings.get<ControllerSettings>(),
                                            context.path, context.ahead_m);
          }};
}

}  // namespace tether
