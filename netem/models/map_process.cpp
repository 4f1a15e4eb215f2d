#include "netem/models/map_process.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "common/base/errors.hpp"
#include "netem/models/kinds.hpp"

namespace tether {
namespace {

constexpr Range kPosition{-1e6, 1e6, false};  // m, dB, ms

std::vector<ScenarioKey> keys(const LinkField& field) {
  auto t = field.keys_of<MapConfig>("map");
  t.file("file", &MapConfig::file, "Esri ASCII raster of SNR in dB; or ...");
  t.rows("access_points", &MapConfig::access_points, kPosition,
         "... [[x_m, y_m], ...] or [[x_m, y_m, snr_1m_db], ...]");
  t.number("snr_1m_db", &MapConfig::snr_1m_db, {-200.0, 300.0, false},
           "access points: SNR at a distance of 1 m");
  t.number("path_loss_exponent", &MapConfig::path_loss_exponent, {0.0, 10.0, false},
           "access points: SNR falls by 10 times this per decade of distance");
  t.number("handover_s", &MapConfig::handover_s, {0.0, 1e3, false},
           "access points: interruption after a change of the access point");
  t.number("shadowing_sd_db", &MapConfig::shadowing_sd_db, {0.0, 50.0, false},
           "standard deviation of log-normal shadowing; 0 = none");
  t.number("shadowing_distance_m", &MapConfig::shadowing_distance_m, {1e-3, 1e6, false},
           "distance at which the shadowing's correlation is 1/e");
  t.number("snr50_db", &MapConfig::snr50_db, {-200.0, 300.0, false},
           "SNR at which half of the packets get through");
  t.number("slope_db", &MapConfig::slope_db, {1e-3, 100.0, false},
           "prr = 1/(1 + exp(-(snr - snr50_db)/slope_db))");
  t.rows("prr_curve", &MapConfig::prr_curve, kPosition,
         "instead of the two: [[snr_db, prr], ...], linear between");
  t.number("delay_ms", &MapConfig::delay_ms, kDelayRange_ms, "delay everywhere");
  t.rows("delay_curve", &MapConfig::delay_curve, kPosition,
         "instead: [[snr_db, delay_ms], ...], linear between");
  return t.take();
}

/// Keys of what the others replace, and of shadowing that is not there.
std::string why_no_effect(const std::string& prefix, const LinkConfig& link,
                          const std::string& part) {
  const auto& map = link.own.get<MapConfig>();
  const auto is_one_of = [key = part.substr(std::string_view("map.").size())](
                             std::initializer_list<std::string_view> keys) {
    return std::find(keys.begin(), keys.end(), key) != keys.end();
  };
  if (map.shadowing_sd_db == 0.0 && is_one_of({"shadowing_distance_m"})) {
    return fmt::format("{}map.shadowing_sd_db is 0", prefix);
  }
  if (!map.file.empty() && is_one_of({"snr_1m_db", "path_loss_exponent", "handover_s"})) {
    return fmt::format("{}map.file is given", prefix);
  }
  if (!map.prr_curve.empty() && is_one_of({"snr50_db", "slope_db"})) {
    return fmt::format("{}map.prr_curve is given", prefix);
  }
  if (!map.delay_curve.empty() && is_one_of({"delay_ms"})) {
    return fmt::format("{}map.delay_curve is given", prefix);
  }
  return "";
}

ProcessPtr make(const ProcessNeeds& needs) {
  if (needs.shared) return needs.shared;
  if (needs.same<MapConfig>()) return needs.present;
  // Obstacles shadow every link: the streams are not the link's.
  ProcessPtr made =
      make_map_process(needs.link.own.get<MapConfig>(), needs.prefix + "map.",
                       [seed = needs.seed](std::string_view place) {
                         return random_stream(seed, "shadowing/" + std::string(place));
                       });
  const auto old = needs.present_as<MapProcess>();
  if (const auto where = old ? old->position() : std::nullopt) {
    made->on_position(where->x_m, where->y_m, needs.now);
  }
  return made;
}

void export_loss(const LinkConfig&, const TcSender&, TcDraft& out) {
  out.notes.emplace_back("model = \"map\" has no equivalent: netem knows no position");
  out.command += tc_random_loss(out.loss);
}

}  // namespace

MapProcess::MapProcess(const MapConfig& config, std::shared_ptr<const PositionMap> grid,
                       const std::string& key_prefix, const ShadowingStreams& shadowing)
    : config_(config), grid_(std::move(grid)) {
  for (const auto& point : config.access_points) {
    if (point.size() != 2 && point.size() != 3) {
      throw UsageError(fmt::format(
          "{}access_points: each must be [x_m, y_m] or [x_m, y_m, snr_1m_db]", key_prefix));
    }
    access_points_.push_back({point[0], point[1], point.size() == 3 ? point[2] : config.snr_1m_db});
  }
  if ((grid_ != nullptr) != access_points_.empty()) {
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
  std::shared_ptr<const PositionMap> grid;
  try {
    if (!config.file.empty()) grid = PositionMap::kept(config.file);
  } catch (const UsageError& error) {
    throw UsageError(fmt::format("{}file: {}", key_prefix, error.what()));
  }
  return std::make_shared<MapProcess>(config, std::move(grid), key_prefix, shadowing);
}

ChannelModelKind map_model() {
  ChannelModelKind kind{.name = "map", .needs_position = true, .keys = keys};
  kind.not_shared = same_settings<MapConfig>;
  kind.moves = [](const LinkConfig&) { return ChannelModelKind::Moves::in_time; };
  kind.why_no_effect = why_no_effect;
  kind.make = make;
  kind.why_open = "where the vehicle is decides";
  kind.export_loss = export_loss;
  return kind;
}

}  // namespace tether
