#include "netem/models/map_process.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "common/base/errors.hpp"

namespace tether {

MapProcess::MapProcess(const MapConfig& config, std::optional<PositionMap> grid,
                       const std::string& key_prefix, const ShadowingStreams& shadowing)
    : config_(config), grid_(std::move(grid)) {
  for (const auto& point : config.access_points) {
    if (point.size() != 2 && point.size() != 3) {
      throw UsageError(fmt::format(
          "{}access_points: each must be [x_m, y_m] or [x_m, y_m, snr_1m_db]", key_prefix));
    }
    access_points_.push_back({point[0], point[1], point.size() == 3 ? point[2] : config.snr_1m_db});
  }
  if (grid_.has_value() != access_points_.empty()) {
    throw UsageError(
        fmt::format("model = \"map\" needs one of {0}file and {0}access_points", key_prefix));
  }
  if (!config.prr_curve.empty()) {
    prr_curve_.emplace(config.prr_curve, 0.0, 1.0, key_prefix + "prr_curve");
  }
  if (!config.delay_curve.empty()) {
    delay_curve_.emplace(config.delay_curve, 0.0, 1e6, key_prefix + "delay_curve");
  }
  const auto add_shadowing = [&](const std::string& place) {
    RandomEngine random = shadowing(place);
    shadowing_.emplace_back(config.shadowing_sd_db, config.shadowing_distance_m, random);
  };
  if (grid_) add_shadowing("grid");
  for (const AccessPoint& ap : access_points_) add_shadowing(fmt::format("{},{}", ap.x_m, ap.y_m));
  move_to(0.0, 0.0);
}

std::size_t MapProcess::nearest_to(double x_m, double y_m) const {
  std::size_t nearest = 0;
  double shortest = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < access_points_.size(); ++i) {
    const double d = std::hypot(x_m - access_points_[i].x_m, y_m - access_points_[i].y_m);
    if (d >= shortest) continue;
    shortest = d;
    nearest = i;
  }
  return nearest;
}

double MapProcess::snr_db(double x_m, double y_m) const {
  const std::size_t i = nearest_to(x_m, y_m);
  const double shadowing_db = shadowing_[i].at(x_m, y_m);
  if (grid_) return grid_->at(x_m, y_m) + shadowing_db;
  const AccessPoint& ap = access_points_[i];
  const double distance_m = std::max(1.0, std::hypot(x_m - ap.x_m, y_m - ap.y_m));
  return ap.snr_1m_db - 10.0 * config_.path_loss_exponent * std::log10(distance_m) + shadowing_db;
}

LinkCondition MapProcess::condition_at_snr(double snr_db) const {
  const double prr = prr_curve_
                         ? prr_curve_->at(snr_db)
                         : 1.0 / (1.0 + std::exp((config_.snr50_db - snr_db) / config_.slope_db));
  const double delay_ms = delay_curve_ ? delay_curve_->at(snr_db) : config_.delay_ms;
  return {prr, from_seconds(delay_ms * 1e-3)};
}

void MapProcess::move_to(double x_m, double y_m) {
  nearest_ = nearest_to(x_m, y_m);
  condition_ = condition_at_snr(snr_db(x_m, y_m));
}

void MapProcess::advance(Instant now) { now_ = std::max(now_, now); }

void MapProcess::on_position(double x_m, double y_m, Instant now) {
  advance(now);
  constexpr double kFarthest_m = 1e9;  // positions come from the network: keep the last good one
  if (!(std::abs(x_m) <= kFarthest_m && std::abs(y_m) <= kFarthest_m)) return;
  if (position_ && position_->x_m == x_m && position_->y_m == y_m) return;  // nothing is another
  const std::size_t before = nearest_;
  move_to(x_m, y_m);
  if (position_ && nearest_ != before) {
    handover_until_ = now_ + from_seconds(config_.handover_s);
  }
  position_ = {x_m, y_m};
}

LinkCondition MapProcess::condition() const {
  return now_ < handover_until_ ? LinkCondition{0.0, condition_.delay} : condition_;
}

Instant MapProcess::next_transition() const {
  return now_ < handover_until_ ? handover_until_ : Instant::max();
}

std::shared_ptr<ChannelProcess> make_map_process(const MapConfig& config,
                                                 const std::string& key_prefix,
                                                 const ShadowingStreams& shadowing) {
  std::optional<PositionMap> grid;
  try {
    if (!config.file.empty()) grid = PositionMap::load(config.file);
  } catch (const UsageError& error) {
    throw UsageError(fmt::format("{}file: {}", key_prefix, error.what()));
  }
  return std::make_shared<MapProcess>(config, std::move(grid), key_prefix, shadowing);
}

}  // namespace tether
