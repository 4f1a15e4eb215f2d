#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <sstream>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "netem/models/map_process.hpp"
#include "netem/models/shadowing.hpp"
#include "tests/support/refusal.hpp"

namespace tether {
namespace {

Instant at_s(double seconds) { return kStart + from_seconds(seconds); }

PositionMap grid(const std::string& text) {
  std::istringstream in(text);
  return PositionMap::read(in, "m.asc");
}

template <class Function>
std::string refusal(Function function) {
  return refusal_of(function);
}

// Centres at x = 0, 2, 4 and y = 10, 12.
const char* const kGrid =
    "ncols 3\n"
    "nrows 2\n"
    "xllcorner -1\n"
    "yllcorner 9\n"
    "cellsize 2\n"
    "NODATA_value -9999\n"
    "30 20 10\n"
    "0 4 8\n";

// ---------------------------------------------------------------------------- grid

TEST(PositionMap, HasTheFilesValuesAtTheCentresOfCells) {
  const PositionMap m = grid(kGrid);
  EXPECT_EQ(m.at(0, 12), 30);
  EXPECT_EQ(m.at(4, 12), 10);
  EXPECT_EQ(m.at(0, 10), 0);
  EXPECT_EQ(m.at(4, 10), 8);
}

TEST(PositionMap, IsBilinearBetweenAndConstantBeyond) {
  const PositionMap m = grid(kGrid);
  EXPECT_DOUBLE_EQ(m.at(1, 12), 25);
  EXPECT_DOUBLE_EQ(m.at(2, 11), 12);
  EXPECT_DOUBLE_EQ(m.at(0.5, 10.5),
                   0.75 * 0.75 * 0 + 0.25 * 0.75 * 4 + 0.75 * 0.25 * 30 + 0.0625 * 20);
  EXPECT_DOUBLE_EQ(m.at(-50, 12), 30);
  EXPECT_DOUBLE_EQ(m.at(3, -50), 6);
}

TEST(PositionMap, TakesCentresForCornersAndOneCell) {
  const PositionMap m = grid("NROWS 1\nNCOLS 1\nxllcenter 5\nyllcenter 5\ncellsize 1\n-3.5\n");
  EXPECT_EQ(m.at(0, 0), -3.5);
  EXPECT_EQ(m.at(5, 9), -3.5);
}

TEST(PositionMap, RefusesWithFileAndLine) {
  const std::string head = "ncols 2\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize 1\n";
  const std::vector<std::pair<std::string, std::string>> cases{
      {head + "1\n", "m.asc:6: ends before cell 2 of 2"},
      {head + "1 x\n", "m.asc:6: cell 2 of 2 = \"x\" must be a finite number"},
      {head + "1 2\n3\n", "m.asc:7: \"3\" comes after the last of the 2 cells"},
      {head, "m.asc:5: ends before the grid"},
      {"nrows 1\n1\n", "m.asc:2: the header has no ncols"},
      {"ncols 1.5\nnrows 1\n1\n", "m.asc:3: ncols = 1.5 must be a whole number from 1 to 10000"},
      {"ncols 1\nnrows 1\nyllcorner 0\ncellsize 1\n1\n",
       "m.asc:5: the header needs one of xllcorner and xllcenter"},
      {"ncols 1\nnrows 1\nxllcorner 0\nyllcorner 0\n1\n",
       "m.asc:5: the header needs a cellsize above 0"},
      {"NODATA_value -1\n" + head + "1 -1\n",
       "m.asc:7: a cell without data: give it an SNR, such as -100 where nothing is received"}};
  for (const auto& [text, message] : cases) {
    const std::string& content = text;
    EXPECT_EQ(refusal([&] { grid(content); }), message);
  }
  EXPECT_THROW(PositionMap::load("/nowhere/m.asc"), UsageError);
}

TEST(Curve, IsLinearBetweenItsPointsAndConstantBeyond) {
  const Curve c({{0, 0.0}, {10, 0.5}, {12, 1.0}}, 0.0, 1.0, "k");
  EXPECT_EQ(c.at(-5), 0.0);
  EXPECT_DOUBLE_EQ(c.at(4), 0.2);
  EXPECT_DOUBLE_EQ(c.at(11), 0.75);
  EXPECT_EQ(c.at(50), 1.0);
}

TEST(Curve, RefusesDisorder) {
  EXPECT_EQ(refusal([] {
              Curve({{0, 0}, {0, 1}}, 0, 1, "k");
            }),
            "k: 0 must be above the point's before");
  EXPECT_EQ(refusal([] { Curve({{0, 0}, {1, 2}}, 0, 1, "k"); }), "k: 2 must be in [0, 1]");
  EXPECT_EQ(refusal([] { Curve({{0, 0}, {1}}, 0, 1, "k"); }), "k must be a list of pairs [x, y]");
  EXPECT_EQ(refusal([] { Curve({{0, 0}}, 0, 1, "k"); }), "k needs two points or more");
}

// ---------------------------------------------------------------------------- shadowing

TEST(Shadowing, HasTheVarianceAndGudmundsonsCorrelation) {
  constexpr int kRealisations = 4000;
  constexpr double kSd = 6.0, kDistance = 8.0;
  const std::vector<double> distances{0.0, 2.0, 8.0, 20.0};
  std::vector<double> products(distances.size());
  double sum = 0.0, fourth = 0.0;
  for (std::uint64_t seed = 1; seed <= kRealisations; ++seed) {
    RandomEngine random(seed);
    const Shadowing s(kSd, kDistance, random);
    const double here = s.at(3.0, -4.0);
    sum += here;
    fourth += std::pow(here / kSd, 4);
    for (std::size_t i = 0; i < distances.size(); ++i) {
      products[i] += here * s.at(3.0 + 0.6 * distances[i], -4.0 + 0.8 * distances[i]);
    }
  }
  // The product of normal pairs with correlation ρ has variance σ⁴(1 + ρ²). 5 standard errors.
  EXPECT_NEAR(sum / kRealisations, 0.0, 5.0 * kSd / std::sqrt(kRealisations));
  for (std::size_t i = 0; i < distances.size(); ++i) {
    const double rho = std::exp(-distances[i] / kDistance);
    EXPECT_NEAR(products[i] / kRealisations, kSd * kSd * rho,
                5.0 * kSd * kSd * std::sqrt((1.0 + rho * rho) / kRealisations))
        << distances[i] << " m";
  }
  // Normal: E[z⁴] = 3, Var[z⁴] = 96.
  EXPECT_NEAR(fourth / kRealisations, 3.0, 5.0 * std::sqrt(96.0 / kRealisations));
}

TEST(Shadowing, OneRealisationHasItToo) {
  // Along a line of 4 km, 500 correlation lengths: the variance of the mean square over a length L
  // is 2σ⁴·D/L for correlation exp(−2d/D) of the squares.
  RandomEngine random(7);
  const Shadowing s(5.0, 8.0, random);
  constexpr int kPoints = 8000;
  double squares = 0.0;
  for (int i = 0; i < kPoints; ++i) squares += std::pow(s.at(0.5 * i, 0.1 * i), 2) / kPoints;
  EXPECT_NEAR(squares, 25.0, 5.0 * 25.0 * std::sqrt(2.0 * 8.0 / 4000.0));
}

TEST(Shadowing, IsTheSameForTheSameSeedAndNoneWithoutVariance) {
  RandomEngine a(1), b(1), c(2), d(1);
  EXPECT_EQ(Shadowing(6, 10, a).at(1, 2), Shadowing(6, 10, b).at(1, 2));
  EXPECT_NE(Shadowing(6, 10, d).at(1, 2), Shadowing(6, 10, c).at(1, 2));
  EXPECT_EQ(Shadowing(0, 10, a).at(1, 2), 0.0);
}

// ---------------------------------------------------------------------------- process

ShadowingStreams seeded(std::uint64_t seed) {
  return [seed](std::string_view place) { return random_stream(seed, place); };
}

MapConfig two_access_points() {
  MapConfig c;
  c.access_points = {{0, 0}, {100, 0, 40}};
  c.snr_1m_db = 50;
  c.path_loss_exponent = 2.0;
  c.delay_ms = 3.0;
  return c;
}

TEST(MapProcess, FollowsTheLogDistanceLawOfTheNearestAccessPoint) {
  MapProcess p(two_access_points(), nullptr, "", seeded(1));
  EXPECT_DOUBLE_EQ(p.snr_db(10, 0), 30.0);
  EXPECT_DOUBLE_EQ(p.snr_db(0, 0.1), 50.0);  // not below 1 m
  EXPECT_DOUBLE_EQ(p.snr_db(100, 10), 20.0);
  EXPECT_TRUE(p.wants_position());
}

TEST(MapProcess, TurnsSnrIntoPrrByTheLogisticCurve) {
  MapConfig c = two_access_points();
  c.snr50_db = 30.0;
  c.slope_db = 2.0;
  MapProcess p(c, nullptr, "", seeded(1));
  p.on_position(10, 0, at_s(1));  // 30 dB
  EXPECT_DOUBLE_EQ(p.condition().prr, 0.5);
  EXPECT_EQ(p.condition().delay, std::chrono::milliseconds{3});
  EXPECT_DOUBLE_EQ(p.condition_at_snr(32.0).prr, 1.0 / (1.0 + std::exp(-1.0)));
  EXPECT_EQ(p.condition_at_snr(-1e5).prr, 0.0);
  EXPECT_EQ(p.condition_at_snr(1e5).prr, 1.0);
}

TEST(MapProcess, TakesCurvesInstead) {
  MapConfig c = two_access_points();
  c.prr_curve = {{0, 0.0}, {50, 1.0}};
  c.delay_curve = {{0, 100.0}, {50, 0.0}};
  MapProcess p(c, nullptr, "", seeded(1));
  p.on_position(10, 0, at_s(1));
  EXPECT_DOUBLE_EQ(p.condition().prr, 0.6);
  EXPECT_EQ(p.condition().delay, std::chrono::milliseconds{40});
}

TEST(MapProcess, NothingGetsThroughDuringAHandover) {
  MapConfig c = two_access_points();
  c.snr50_db = -100.0;
  c.handover_s = 0.2;
  MapProcess p(c, nullptr, "", seeded(1));
  p.on_position(60, 0, at_s(0));  // the first position is no handover
  EXPECT_EQ(p.state(), 1);
  EXPECT_GT(p.condition().prr, 0.99);
  p.on_position(40, 0, at_s(5));
  EXPECT_EQ(p.state(), 0);
  EXPECT_EQ(p.condition().prr, 0.0);
  EXPECT_EQ(p.next_transition(), at_s(5.2));
  EXPECT_EQ(p.on_packet(at_s(5.2) - Duration{1}).prr, 0.0);
  EXPECT_GT(p.on_packet(at_s(5.2)).prr, 0.99);
  EXPECT_EQ(p.next_transition(), Instant::max());
}

TEST(MapProcess, ReadsAGrid) {
  MapConfig c;
  c.prr_curve = {{0, 0.0}, {40, 1.0}};
  MapProcess p(c, std::make_shared<const PositionMap>(grid(kGrid)), "", seeded(1));
  p.on_position(1, 12, at_s(1));
  EXPECT_DOUBLE_EQ(p.condition().prr, 25.0 / 40.0);
  EXPECT_EQ(p.state(), 0);
}

TEST(MapProcess, ShadowingIsOfThePlaceNotOfTheWayThere) {
  MapConfig c = two_access_points();
  c.shadowing_sd_db = 6.0;
  MapProcess direct(c, nullptr, "", seeded(3)), around(c, nullptr, "", seeded(3));
  direct.on_position(20, 5, at_s(1));
  for (int i = 0; i < 50; ++i) around.on_position(i, -i, at_s(1 + 0.1 * i));
  around.on_position(20, 5, at_s(10));
  EXPECT_EQ(direct.condition(), around.condition());
  EXPECT_NE(direct.snr_db(20, 5), MapProcess(c, nullptr, "", seeded(4)).snr_db(20, 5));
  EXPECT_NE(direct.snr_db(20, 5), 50.0 - 20.0 * std::log10(std::hypot(20, 5)));
}

TEST(MapProcess, ShadowingIsOfTheAccessPointInWhicheverOrderTheyStand) {
  MapConfig c = two_access_points();
  c.shadowing_sd_db = 6.0;
  const MapProcess p(c, nullptr, "", seeded(1));
  std::swap(c.access_points[0], c.access_points[1]);
  const MapProcess swapped(c, nullptr, "", seeded(1));
  EXPECT_EQ(p.snr_db(20, 5), swapped.snr_db(20, 5));
  EXPECT_EQ(p.snr_db(70, 5), swapped.snr_db(70, 5));
  c.access_points = {{0, 1}, {100, 0, 40}};
  EXPECT_GT(std::abs(p.snr_db(20, 5) - MapProcess(c, nullptr, "", seeded(1)).snr_db(20, 5)), 0.5);
}

TEST(MapProcess, KeepsThePlaceIfThePositionIsNonsense) {
  MapProcess p(two_access_points(), nullptr, "", seeded(1));
  p.on_position(10, 0, at_s(1));
  const LinkCondition before = p.condition();
  for (double bad : {std::nan(""), std::numeric_limits<double>::infinity(), 1e300})
    p.on_position(bad, 0, at_s(2));
  EXPECT_EQ(p.condition(), before);
}

TEST(MapProcess, RefusesWhatMakesNoSense) {
  const auto make = [](const MapConfig& c) {
    return refusal([&] { make_map_process(c, "channel.uplink.map.", seeded(1)); });
  };
  EXPECT_EQ(
      make({}),
      "model = \"map\" needs one of channel.uplink.map.file and channel.uplink.map.access_points");
  MapConfig c;
  c.access_points = {{1}};
  EXPECT_EQ(make(c),
            "channel.uplink.map.access_points: each must be [x_m, y_m] or [x_m, y_m, snr_1m_db]");
  c = two_access_points();
  c.prr_curve = {{0, 0}, {1, 1.5}};
  EXPECT_EQ(make(c), "channel.uplink.map.prr_curve: 1.5 must be in [0, 1]");
  c = two_access_points();
  c.file = "/nowhere/m.asc";
  EXPECT_EQ(make(c),
            "channel.uplink.map.file: cannot read the map \"/nowhere/m.asc\": No such file or "
            "directory");
}

}  // namespace
}  // namespace tether
