#include "onboard/localiser/pose_search.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "common/base/random.hpp"
#include "common/vehicle/frames.hpp"

namespace tether {
namespace {

// Spacing of new particles.
constexpr double kSpacing_m = 0.5;
constexpr int kYaws = 72;
constexpr double kYawStep_rad = 2.0 * std::numbers::pi / kYaws;
constexpr std::size_t kCoarseBeams = 40;
constexpr std::size_t kFirstBeams = 10;  ///< say whether it is worth while to ask the others
/// It is, if they fit this share as well as those of the best yaw so far.
constexpr float kHopeful = 0.75F;
constexpr std::size_t kStride = 17;  ///< through the beams, so that the first look all around
constexpr double kCoarseCell_m = 0.2;
constexpr double kCoarseSigma_m = 0.35;  ///< error that a place may have
constexpr float kFree_m = 0.3F;          ///< to the next outline
// Maximum number of candidates that climb.
constexpr std::size_t kClimbing = 6;
constexpr std::size_t kClimbingBeams = 100;
constexpr double kReach_m = 1.5;
constexpr double kKeptReach_m = 0.3;
// Maximum number of candidates that are kept.
constexpr std::size_t kKept = 12;
constexpr double kSame_m = 0.3;
constexpr double kSame_rad = 0.1;
constexpr double kMemory_scans = 30.0;
// Sweeps for the found candidate.
/// So often all places are looked at: what climbs from near the right one does not always arrive.
constexpr std::size_t kSweeps = 2;
constexpr int kLeastScans = 5;
constexpr double kLeastFit = 0.55;
/// Lead in fit over every other place after kLeastScans; after more scans less, down to
/// kJustBetter. A mean of 30 scans of 100 beams' weights, each of which has about 0.13, is a tenth
/// of that; but objects that the map lacks appear in every scan.
constexpr double kClearlyBetter = 0.08;
constexpr double kJustBetter = 0.05;
constexpr int kLeastBeams = 30;

std::vector<Beam> some_of(std::span<const Beam> beams, std::size_t most) {
  const std::size_t count = std::min(most, beams.size());
  std::vector<Beam> some;
  some.reserve(count);
  for (std::size_t i = 0; i < count; ++i) some.push_back(beams[i * beams.size() / count]);
  return some;
}

bool same_place(const Pose2& a, const Pose2& b) {
  return std::hypot(a.x_m - b.x_m, a.y_m - b.y_m) < kSame_m &&
         std::abs(wrap_angle(a.yaw_rad - b.yaw_rad)) < kSame_rad;
}

}  // namespace

PoseSearch::PoseSearch(std::shared_ptr<const DistanceField> field, const Settings& settings,
                       RandomEngine random)
    : field_(std::move(field)), settings_(settings), random_(random) {
  coarse_columns_ = static_cast<std::size_t>(field_->width_m() / kCoarseCell_m) + 1;
  coarse_rows_ = static_cast<std::size_t>(field_->height_m() / kCoarseCell_m) + 1;
  coarse_.reserve(coarse_columns_ * coarse_rows_);
  for (std::size_t r = 0; r < coarse_rows_; ++r) {
    for (std::size_t c = 0; c < coarse_columns_; ++c) {
      const double x_m = field_->left_m() + (static_cast<double>(c) + 0.5) * kCoarseCell_m;
      const double y_m = field_->bottom_m() + (static_cast<double>(r) + 0.5) * kCoarseCell_m;
      const double sigmas =
          field_->at(static_cast<float>(x_m), static_cast<float>(y_m)).distance_m / kCoarseSigma_m;
      coarse_.push_back(static_cast<float>(std::exp(-0.5 * sigmas * sigmas)));
    }
  }
  find_places();
}

void PoseSearch::find_places() {
  const auto columns = static_cast<int>(field_->width_m() / kSpacing_m);
  const auto rows = static_cast<int>(field_->height_m() / kSpacing_m);
  std::vector<bool> is_free(static_cast<std::size_t>(columns * rows));
  const auto place_of = [&](std::size_t i) {
    const int r = static_cast<int>(i) / columns, c = static_cast<int>(i) % columns;
    return Pose2{field_->left_m() + (c + 0.5) * kSpacing_m,
                 field_->bottom_m() + (r + 0.5) * kSpacing_m, 0.0};
  };
  for (std::size_t i = 0; i < is_free.size(); ++i) {
    const Pose2 place = place_of(i);
    const float distance_m =
        field_->at(static_cast<float>(place.x_m), static_cast<float>(place.y_m)).distance_m;
    is_free[i] = distance_m > kFree_m && distance_m < DistanceField::kFar_m;
  }
  keep_what_can_be_reached(is_free, columns);
  for (std::size_t i = 0; i < is_free.size(); ++i) {
    if (is_free[i]) places_.push_back(place_of(i));
  }
  shuffle(places_, random_);
}

/// From the free cell that is nearest to settings_.inside, from cell to cell beside it.
void PoseSearch::keep_what_can_be_reached(std::vector<bool>& is_free, int columns) const {
  const double column = (settings_.inside.x_m - field_->left_m()) / kSpacing_m - 0.5;
  const double row = (settings_.inside.y_m - field_->bottom_m()) / kSpacing_m - 0.5;
  const auto away = [&](std::size_t i) {
    const int in_column = static_cast<int>(i) % columns, in_row = static_cast<int>(i) / columns;
    return std::hypot(in_column - column, in_row - row);
  };
  std::vector<std::size_t> edge;
  for (std::size_t i = 0; i < is_free.size(); ++i) {
    if (!is_free[i] || (!edge.empty() && away(i) >= away(edge.front()))) continue;
    edge = {i};
  }
  std::vector<bool> reached(is_free.size());
  const auto visit = [&](std::size_t i) {
    if (i >= is_free.size() || !is_free[i] || reached[i]) return;
    reached[i] = true;
    edge.push_back(i);
  };
  for (const std::size_t first : std::exchange(edge, {})) visit(first);
  const auto stride = static_cast<std::size_t>(columns);
  while (!edge.empty()) {
    const std::size_t i = edge.back();
    edge.pop_back();
    if (i % stride > 0) visit(i - 1);
    if (i % stride + 1 < stride) visit(i + 1);
    if (i >= stride) visit(i - stride);
    visit(i + stride);
  }
  is_free = reached;
}

int PoseSearch::sweep_scans() const {
  const double each = std::max(1, settings_.draws / kYaws);
  return static_cast<int>(std::ceil(static_cast<double>(places_.size()) / each));
}

void PoseSearch::begin() {
  particles_.clear();
  looked_at_ = 0;
}

void PoseSearch::suggest(const Pose2& pose) { particles_.push_back({pose}); }

void PoseSearch::move(const Pose2& step) {
  for (Particle& particle : particles_) particle.pose = compose(particle.pose, step);
}

std::optional<Pose2> PoseSearch::best() const {
  if (particles_.empty()) return std::nullopt;
  return particles_.front().pose;
}

float PoseSearch::coarse_weight(const Pose2& place, std::span<const Beam> turned,
                                float best) const {
  const auto per_m = static_cast<float>(1.0 / kCoarseCell_m);
  const auto x_m = static_cast<float>(place.x_m - field_->left_m());
  const auto y_m = static_cast<float>(place.y_m - field_->bottom_m());
  const auto columns = static_cast<float>(coarse_columns_);
  const auto rows = static_cast<float>(coarse_rows_);
  const float hopeful =
      kHopeful * best * static_cast<float>(kFirstBeams) / static_cast<float>(turned.size());
  float sum = 0.0F;
  std::size_t n = 0;
  for (const Beam& beam : turned) {
    if (n++ == kFirstBeams && sum < hopeful) break;
    const float column = (x_m + beam.x_m) * per_m, row = (y_m + beam.y_m) * per_m;
    if (!(column >= 0.0F && row >= 0.0F && column < columns && row < rows)) continue;
    sum +=
        coarse_[static_cast<std::size_t>(row) * coarse_columns_ + static_cast<std::size_t>(column)];
  }
  return sum;
}

/// The next places of the sweep, each with its best yaw; the heaviest kClimbing of them.
std::vector<PoseSearch::Drawn> PoseSearch::draw(std::span<const Beam> beams) {
  std::vector<Beam> few;
  for (std::size_t i = 0; i < kCoarseBeams; ++i) {
    few.push_back(beams[i * kStride % kCoarseBeams * beams.size() / kCoarseBeams]);
  }
  const double first_rad = kYawStep_rad * uniform_01(random_);
  std::vector<Beam> turned;
  turned.reserve(kYaws * few.size());
  for (int i = 0; i < kYaws; ++i) {
    const auto c = static_cast<float>(std::cos(first_rad + i * kYawStep_rad));
    const auto s = static_cast<float>(std::sin(first_rad + i * kYawStep_rad));
    for (const Beam& beam : few) {
      turned.push_back({c * beam.x_m - s * beam.y_m, s * beam.x_m + c * beam.y_m});
    }
  }
  std::vector<Drawn> drawn;
  const auto places = static_cast<std::size_t>(std::max(1, settings_.draws / kYaws));
  for (std::size_t n = 0; n < std::min(places, places_.size()); ++n) {
    Pose2 place = places_[next_place_];
    next_place_ = (next_place_ + 1) % places_.size();
    place.x_m += kSpacing_m * (uniform_01(random_) - 0.5);
    place.y_m += kSpacing_m * (uniform_01(random_) - 0.5);
    Drawn best{place, -1.0F};
    for (int i = 0; i < kYaws; ++i) {
      const float weight = coarse_weight(
          place, std::span(turned).subspan(static_cast<std::size_t>(i) * few.size(), few.size()),
          best.weight);
      if (weight <= best.weight) continue;
      best.weight = weight;
      best.pose.yaw_rad = wrap_angle(first_rad + i * kYawStep_rad);
    }
    drawn.push_back(best);
  }
  looked_at_ += drawn.size();
  const std::size_t kept = std::min(kClimbing, drawn.size());
  std::partial_sort(drawn.begin(), drawn.begin() + static_cast<std::ptrdiff_t>(kept), drawn.end(),
                    [](const Drawn& a, const Drawn& b) { return a.weight > b.weight; });
  drawn.resize(kept);
  return drawn;
}

void PoseSearch::climb(Particle& particle, std::span<const Beam> beams, double reach_m) const {
  MatchSettings settings = settings_.match;
  settings.max_distance_m = reach_m;
  const Match match = match_scan(*field_, beams, particle.pose, settings);
  particle.pose = match.pose;
  ++particle.scans;
  const double share = 1.0 / std::min(static_cast<double>(particle.scans), kMemory_scans);
  particle.fit += share * (match.fit - particle.fit);
}

void PoseSearch::keep_the_heaviest() {
  std::stable_sort(particles_.begin(), particles_.end(), [](const Particle& a, const Particle& b) {
    return a.fit != b.fit ? a.fit > b.fit : a.scans > b.scans;
  });
  std::vector<Particle> kept;
  for (const Particle& particle : particles_) {
    const auto same = std::find_if(kept.begin(), kept.end(), [&](const Particle& other) {
      return same_place(particle.pose, other.pose);
    });
    if (same == kept.end()) {
      if (kept.size() < kKept) kept.push_back(particle);
    } else {
      same->scans = std::max(same->scans, particle.scans);
    }
  }
  particles_ = std::move(kept);
}

std::optional<Match> PoseSearch::clear_winner(std::span<const Beam> beams) const {
  if (particles_.empty() || looked_at_ < kSweeps * places_.size()) return std::nullopt;
  const Particle& best = particles_.front();
  if (best.scans < kLeastScans || best.fit < kLeastFit) return std::nullopt;
  const double better = std::max(kJustBetter, kClearlyBetter * kLeastScans / best.scans);
  if (particles_.size() > 1 && particles_[1].fit > best.fit - better) return std::nullopt;
  const Match match = match_scan(*field_, beams, best.pose, settings_.match);
  if (match.fit < kLeastFit || match.used < kLeastBeams) return std::nullopt;
  return match;
}

std::optional<Match> PoseSearch::look(std::span<const Beam> beams) {
  if (beams.size() < kLeastBeams || places_.empty()) return std::nullopt;
  const std::vector<Beam> some = some_of(beams, kClimbingBeams);
  for (Particle& particle : particles_) climb(particle, some, kKeptReach_m);
  for (const Drawn& drawn : draw(some)) {
    Particle particle{drawn.pose};
    climb(particle, some, kReach_m);
    particles_.push_back(particle);
  }
  keep_the_heaviest();
  return clear_winner(beams);
}

}  // namespace tether
