#include "onboard/localiser/localiser_node.hpp"

#include <algorithm>
#include <memory>
#include <tether/localisation_t.hpp>
#include <tether/pose_t.hpp>
#include <vector>

#include "common/base/random.hpp"
#include "onboard/localiser/distance_field.hpp"

namespace tether {
namespace {

using Place = LocaliserSettings::Place;

/// Shapes of the map that a scanner at this height sees.
std::vector<Shape> seen_shapes(const LocaliserNodeSettings& settings) {
  const double height_m = settings.get<LocaliserSettings>().scan_height_m;
  std::vector<Shape> shapes = mapped_shapes(settings);
  std::erase_if(shapes, [height_m](const Shape& shape) { return !shape.is_at(height_m); });
  return shapes;
}

Localiser localiser_of(const LocaliserNodeSettings& settings) {
  const auto& own = settings.get<LocaliserSettings>();
  const auto& vehicle = settings.get<VehicleSettings>();
  Localiser::Settings out;
  out.tracker = {vehicle.track_m, own.odometry_noise_m};
  out.search.draws = own.particles;
  out.search.inside = {vehicle.start_x_m, vehicle.start_y_m};
  out.search.match.range_noise_m = own.range_noise_m;
  out.search.match.max_distance_m = own.max_distance_m;
  out.max_beams = static_cast<std::size_t>(own.max_beams);
  if (own.knows_start) out.start = vehicle.start_pose();
  out.start_error_m = std::max(out.start_error_m, vehicle.start_error_m);
  out.start_error_rad = std::max(out.start_error_rad, vehicle.start_error_rad);
  return {out, std::make_shared<const DistanceField>(seen_shapes(settings), own.resolution_m),
          random_stream(settings.get<RunSettings>().seed, vehicle.name + "/localiser/search")};
}

std::vector<std::string> inputs(const ChannelNames& c, bool at_edge) {
  if (at_edge) return {c.control_scan_part, c.control_odometry};
  return {c.vehicle_scan, c.vehicle_odometry};
}

std::int32_t number_of(Localisation::State state) {
  switch (state) {
    case Localisation::State::tracking:
      return localisation_t::TRACKING;
    case Localisation::State::degenerate:
      return localisation_t::DEGENERATE;
    case Localisation::State::searching:
      break;
  }
  return localisation_t::SEARCHING;
}

}  // namespace

LocaliserNode::LocaliserNode(const LocaliserNodeSettings& settings, EventLoop& loop, Bus& bus)
    : loop_(loop),
      bus_(bus),
      at_edge_(settings.get<LocaliserSettings>().place == Place::edge),
      channels_(settings.get<VehicleSettings>().name),
      senders_(loop, bus, inputs(channels_, at_edge_)),
      localiser_(localiser_of(settings)),
      assembly_(from_seconds(settings.get<LocaliserSettings>().scan_patience_ms * 1e-3)),
      scan_guard_({.earliest = earliest_stamp(settings)}),
      odometry_guard_({.earliest = earliest_stamp(settings)}),
      counters_(loop, bus, "localiser", channels_.localiser_counters,
                from_seconds(settings.get<RunSettings>().report_period_s),
                [this](CounterList& out) { list_counters(out); }) {
  // Before scans of the same instant.
  subscribe<odometry_t>(bus, at_edge_ ? channels_.control_odometry : channels_.vehicle_odometry,
                        kDeepQueue, undecodable_odometry_,
                        [this](const odometry_t& m) { on_odometry(m); });
  if (at_edge_) {
    listen_at_edge(bus);
  } else {
    listen_on_vehicle(bus);
  }
}

void LocaliserNode::listen_on_vehicle(Bus& bus) {
  subscribe_in_run<scan_t>(bus, loop_, channels_.vehicle_scan, kDeepQueue, rejected_scans_,
                           [this](const scan_t& m) {
                             const std::optional<Scan> scan = to_scan(m);
                             if (!scan) {
                               ++unusable_scans_;
                             } else if (scan_guard_.accept(loop_.now(), scan->stamp, scan->seq)) {
                               on_scan(*scan);
                             }
                           });
}

void LocaliserNode::listen_at_edge(Bus& bus) {
  subscribe_in_run<scan_part_t>(bus, loop_, channels_.control_scan_part, kDeepQueue,
                                rejected_scans_, [this](const scan_part_t& m) { on_part(m); });
}

void LocaliserNode::on_odometry(const odometry_t& m) {
  OdometryReading reading;
  reading.stamp = from_utime(m.utime);
  reading.pose = {m.x_m, m.y_m, m.yaw_rad};
  reading.distance_m = m.distance_m;
  reading.twist = {m.v_mps, m.omega_radps};
  if (!is_usable(reading.pose) || !is_usable(reading.twist) || !is_usable(m.distance_m)) {
    ++unusable_odometry_;
  } else if (odometry_guard_.accept(loop_.now(), reading.stamp, m.seq)) {
    localiser_.on_odometry(reading);
  }
}

void LocaliserNode::on_part(const scan_part_t& m) {
  if (!scan_guard_.accept(loop_.now(), from_utime(m.utime), m.seq)) return;
  if (const std::optional<Scan> ready = assembly_.add(m)) on_scan(*ready);
  if (const auto deadline = assembly_.deadline()) {
    loop_.at(std::max(*deadline, loop_.now()), Priority::node, [this](Instant) { on_overdue(); });
  }
}

void LocaliserNode::on_overdue() {
  if (const std::optional<Scan> ready = assembly_.overdue(loop_.now())) on_scan(*ready);
}

void LocaliserNode::on_scan(const Scan& scan) {
  if (last_end_ && scan.end() <= *last_end_) {
    ++backward_scans_;
    return;
  }
  last_end_ = scan.end();
  const Localisation found = localiser_.on_scan(scan);
  if (found.state != Localisation::State::searching) publish_pose(found, scan.plan);
  publish_localisation(found);
}

void LocaliserNode::publish_pose(const Localisation& found, const PlanName& plan) {
  pose_t message{};
  message.utime = to_utime(found.stamp);
  message.seq = poses_++;
  message.run = loop_.run_id();
  message.x_m = found.pose.x_m;
  message.y_m = found.pose.y_m;
  message.yaw_rad = found.pose.yaw_rad;
  message.plan_session = plan.session;
  message.plan_id = plan.id;
  publish(bus_, at_edge_ ? channels_.control_pose : channels_.vehicle_pose, message);
}

void LocaliserNode::publish_localisation(const Localisation& found) {
  localisation_t message{};
  message.utime = to_utime(found.stamp);
  message.seq = localisations_++;
  message.run = loop_.run_id();
  message.state = number_of(found.state);
  message.x_m = found.pose.x_m;
  message.y_m = found.pose.y_m;
  message.yaw_rad = found.pose.yaw_rad;
  message.cov_x_x_m2 = found.covariance.x_x;
  message.cov_x_y_m2 = found.covariance.x_y;
  message.cov_x_yaw_m_rad = found.covariance.x_yaw;
  message.cov_y_y_m2 = found.covariance.y_y;
  message.cov_y_yaw_m_rad = found.covariance.y_yaw;
  message.cov_yaw_yaw_rad2 = found.covariance.yaw_yaw;
  message.weak_direction_rad = found.weak.direction_rad;
  message.weak_sigma_m = found.weak.sigma_m;
  message.weak_yaw_sigma_rad = found.weak.yaw_sigma_rad;
  message.scan_seq = found.scan_seq;
  message.beams = found.beams;
  message.beams_outside = found.outside;
  message.residual_m = found.residual_m;
  publish(bus_, at_edge_ ? channels_.control_localisation : channels_.vehicle_localisation,
          message);
}

void LocaliserNode::finish() { counters_.publish_now(); }

void LocaliserNode::list_counters(CounterList& out) const {
  scan_guard_.list(at_edge_ ? "scan_part" : "scan", out);
  rejected_scans_.list(at_edge_ ? "scan_part" : "scan", out);
  if (at_edge_) {
    out.emplace_back("scan.complete", assembly_.complete());
    out.emplace_back("scan.incomplete", assembly_.incomplete());
    out.emplace_back("scan_part.late", assembly_.late_parts());
    out.emplace_back("scan_part.repeated", assembly_.duplicated_parts());
    out.emplace_back("scan_part.unusable", assembly_.unusable_parts());
  } else {
    out.emplace_back("scan.unusable", unusable_scans_);
  }
  out.emplace_back("scan.backward", backward_scans_);
  odometry_guard_.list("odometry", out);
  out.emplace_back("odometry.undecodable", undecodable_odometry_);
  out.emplace_back("odometry.unusable", unusable_odometry_);
  localiser_.list_counters(out);
  out.emplace_back("pose.sent", poses_);
  senders_.list(out);
}

}  // namespace tether
