#include <benchmark/benchmark.h>

#include <memory>
#include <vector>

#include "common/vehicle/frames.hpp"
#include "onboard/localiser/localiser.hpp"
#include "tests/localiser/hall.hpp"

// Cost of a scan of 541 beams for the localiser: tracking, against the floor of only reading the
// distance field at the same beams' ends as often; and searching.

namespace tether {
namespace {

using test::hall;
using test::HallScanner;

constexpr std::size_t kScans = 64;

/// Scans from places along a way, and what belongs to them.
struct Way {
  std::vector<Shape> map = hall();
  std::shared_ptr<const DistanceField> field = std::make_shared<const DistanceField>(map, 0.05);
  std::vector<Pose2> places;
  std::vector<Scan> scans;
  std::vector<std::vector<Beam>> beams;

  Way() {
    RandomEngine random = random_stream(1, "scanner");
    for (std::size_t i = 0; i < kScans; ++i) {
      const double share = static_cast<double>(i) / kScans;
      const Pose2 place{2.0 + 3.0 * share, -8.0 + 10.0 * share, 1.3};
      const Instant start = kStart + from_seconds(static_cast<double>(i) / 15.0);
      places.push_back(place);
      scans.push_back(HallScanner().measure(
          map, start, static_cast<std::int64_t>(i), [&](Instant) { return place; }, random));
      beams.push_back(beams_of(scans.back(), {}, start, 1000));
    }
  }
};

const Way& way() {
  static const Way kWay;
  return kWay;
}

/// 3 cm and half a degree off, as odometry would guess it after a while.
Pose2 guess(const Pose2& place) {
  return {place.x_m + 0.02, place.y_m - 0.02, place.yaw_rad + 0.01};
}

void match_one(benchmark::State& state) {
  std::size_t i = 0;
  double passes = 0.0;
  for (auto _ : state) {
    const Match match =
        match_scan(*way().field, way().beams[i], guess(way().places[i]), MatchSettings{});
    benchmark::DoNotOptimize(match.pose.x_m);
    passes += match.passes;
    i = (i + 1) % kScans;
  }
  state.counters["passes"] = passes / static_cast<double>(state.iterations());
}
BENCHMARK(match_one)->Unit(benchmark::kMicrosecond);

void floor_of_reading_the_field(benchmark::State& state) {
  constexpr int kPasses = 8;  // passes of match_one
  std::size_t i = 0;
  for (auto _ : state) {
    const auto x_m = static_cast<float>(way().places[i].x_m);
    const auto y_m = static_cast<float>(way().places[i].y_m);
    for (int pass = 0; pass < kPasses; ++pass) {
      float sum = 0.0F;
      for (const Beam& beam : way().beams[i]) {
        const auto value = way().field->at(x_m + beam.x_m, y_m + beam.y_m);
        sum += value.distance_m + value.by_x + value.by_y;
      }
      benchmark::DoNotOptimize(sum);
    }
    i = (i + 1) % kScans;
  }
}
BENCHMARK(floor_of_reading_the_field)->Unit(benchmark::kMicrosecond);

Localiser::Settings settings(bool knows_start) {
  Localiser::Settings settings;
  if (knows_start) settings.start = way().places.front();
  return settings;
}

/// All of a scan: beams without the distortion by motion, match, filter.
void track_one(benchmark::State& state) {
  Localiser localiser(settings(true), way().field, random_stream(1, "search"));
  std::size_t n = 0;
  std::int64_t lost = 0;
  for (auto _ : state) {
    // To and fro, so that places are near each other.
    const std::size_t i = n % (2 * kScans) < kScans ? n % kScans : kScans - 1 - n % kScans;
    state.PauseTiming();
    Scan scan = way().scans[i];
    scan.stamp = kStart + from_seconds(static_cast<double>(n) / 15.0);
    // It stands during scans.
    const Pose2 wheels = relative_to(way().places.front(), way().places[i]);
    localiser.on_odometry({scan.stamp, wheels, 0.2 * static_cast<double>(n), {}});
    localiser.on_odometry({scan.end(), wheels, 0.2 * static_cast<double>(n), {}});
    state.ResumeTiming();
    if (localiser.on_scan(scan).state == Localisation::State::searching) ++lost;
    ++n;
  }
  state.counters["searching"] = static_cast<double>(lost);
}
BENCHMARK(track_one)->Unit(benchmark::kMicrosecond);

void search_one(benchmark::State& state) {
  PoseSearch search(way().field, PoseSearch::Settings{}, random_stream(1, "search"));
  std::size_t n = 0;
  for (auto _ : state) {
    if (n++ % 75 == 0) search.begin();
    benchmark::DoNotOptimize(search.look(way().beams[0]).has_value());
  }
  state.counters["scans_a_sweep"] = search.sweep_scans();
}
BENCHMARK(search_one)->Unit(benchmark::kMicrosecond);

void make_the_field(benchmark::State& state) {
  for (auto _ : state) {
    const DistanceField field(way().map, 0.05);
    benchmark::DoNotOptimize(field.at(0.0F, 0.0F).distance_m);
  }
}
BENCHMARK(make_the_field)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace tether
