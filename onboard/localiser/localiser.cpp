#include "onboard/localiser/localiser.hpp"

#include <cmath>
#include <utility>

#include "common/vehicle/frames.hpp"

namespace tether {
namespace {

// How well a pose is known that the search has found, beside what its scan says.
constexpr double kFound_m = 0.3;
constexpr double kFound_rad = 0.1;
// How far a vehicle may have gone while its odometry was set to another pose.
constexpr double kForgotten_m = 0.1;
constexpr double kForgotten_rad = 0.05;

PoseCovariance diagonal(double position_m, double yaw_rad) {
  return {position_m * position_m, 0.0, 0.0, position_m * position_m, 0.0, yaw_rad * yaw_rad};
}

}  // namespace

Localiser::Localiser(const Settings& settings, std::shared_ptr<const DistanceField> field,
                     RandomEngine random)
    : settings_(settings), field_(std::move(field)), search_(field_, settings.search, random) {
  if (settings_.start) {
    tracker_.emplace(settings_.tracker, *settings_.start,
                     diagonal(settings_.start_error_m, settings_.start_error_rad));
  }
}

void Localiser::on_odometry(const OdometryReading& reading) {
  if (odometry_.add(reading)) return;
  known_at_.reset();
  if (tracker_) tracker_->widen(kForgotten_m, kForgotten_rad);
}

/// Where the configuration puts them; without odometry they stand.
OdometryTrack::Point Localiser::wheels_at(Instant when) const {
  return odometry_.at(when).value_or(OdometryTrack::Point{});
}

void Localiser::move_to(Instant when) {
  if (known_at_) {
    const OdometryTrack::Point from = wheels_at(*known_at_), to = wheels_at(when);
    if (tracker_) {
      tracker_->move(from, to);
    } else {
      search_.move(relative_to(from.pose, to.pose));
    }
  }
  known_at_ = when;
}

Localisation Localiser::on_scan(const Scan& scan) {
  const Instant when = middle(scan);
  move_to(when);
  const std::vector<Beam> beams = beams_of(scan, odometry_, when, settings_.max_beams);
  Localisation out;
  out.stamp = scan.end();
  if (tracker_) {
    track(scan, beams, out);
  } else {
    search(scan, beams, out);
  }
  if (out.beams > 0) last_used_ = scan.seq;
  out.scan_seq = last_used_;
  return out;
}

void Localiser::track(const Scan& scan, std::span<const Beam> beams, Localisation& out) {
  const Match match = match_scan(*field_, beams, tracker_->pose(), settings_.search.match);
  const bool used = use(scan, beams, match);
  if (used) {
    misses_ = 0;
    ++accepted_;
    sum_nis_ += tracker_->last_nis();
    out.weak = weakness(match.information);
    out.beams = match.used;
    out.residual_m = match.residual_m;
  } else if (beams.size() >= kLeastBeams) {
    ++misses_;  // with fewer beams it says nothing, not even that it does not fit
  }
  out.outside = match.outside;
  if (misses_ >= kMostMisses || tracker_->position_sigma_m() > kLost_m) return lose(match);
  const bool weak = out.weak.sigma_m > kWeak_m || out.weak.yaw_sigma_rad > kWeak_rad;
  out.state = weak ? Localisation::State::degenerate : Localisation::State::tracking;
  PoseTracker at_end = *tracker_;
  at_end.move(wheels_at(middle(scan)), wheels_at(scan.end()));
  out.pose = at_end.pose();
  out.covariance = at_end.covariance();
}

bool Localiser::fits(std::span<const Beam> beams, const Match& match) const {
  if (match.used < kLeastBeams) return false;
  if (match.share() >= kLeastShare) return true;
  if (match.share() < kLeastSeen) return false;
  const int through =
      beams_through_map(*field_, beams, match.pose, settings_.search.match.max_distance_m);
  return match.used >= kLeastShare * (match.used + through);
}

bool Localiser::use(const Scan& scan, std::span<const Beam> beams, const Match& match) {
  if (!fits(beams, match)) {
    ++poor_;
    strays_ = 0;
    return false;
  }
  const OdometryTrack::Point began = wheels_at(scan.stamp), ended = wheels_at(scan.end());
  bool used = tracker_->correct(match, began, ended);
  if (!used) {
    ++gated_;
    strays_ = match.share() < kStrayShare ? 0 : strays_ + 1;
    if (strays_ == kStrays) {
      tracker_.emplace(settings_.tracker, match.pose, diagonal(kFound_m, kFound_rad));
      used = tracker_->correct(match, began, ended);
    }
  }
  if (used) strays_ = 0;
  return used;
}

void Localiser::lose(const Match& match) {
  ++lost_;
  tracker_.reset();
  search_.begin();
  search_.suggest(match.pose);
}

void Localiser::search(const Scan& scan, std::span<const Beam> beams, Localisation& out) {
  const std::optional<Match> found = search_.look(beams);
  out.outside = static_cast<int>(beams.size());
  if (!found) return;
  ++found_;
  misses_ = strays_ = 0;
  tracker_.emplace(settings_.tracker, found->pose, diagonal(kFound_m, kFound_rad));
  track(scan, beams, out);
}

void Localiser::list_counters(CounterList& out) const {
  out.emplace_back("match.accepted", accepted_);
  out.emplace_back("match.gated", gated_);
  out.emplace_back("match.poor", poor_);
  const double mean_nis = accepted_ == 0 ? 0.0 : sum_nis_ / static_cast<double>(accepted_);
  out.emplace_back("match.nis_per_mille", std::llround(1000.0 * mean_nis));
  out.emplace_back("localiser.lost", lost_);
  out.emplace_back("localiser.found", found_);
}

}  // namespace tether
