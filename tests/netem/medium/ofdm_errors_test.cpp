#include "netem/medium/ofdm_errors.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <map>
#include <vector>

namespace tether {
namespace {

// ns-3, src/wifi/test/wifi-error-rate-models-test.cc: success of 2000 bytes, as rounded there.
TEST(OfdmErrors, AreThoseOfNs3) {
  struct Row {
    double rate_Mbps, snr_db, success;
  };
  for (const Row& row :
       {Row{6, 3.0, 0.020},   Row{6, 4.0, 0.885},   Row{6, 5.0, 0.997},   Row{9, 6.0, 0.097},
        Row{9, 7.0, 0.918},   Row{9, 8.0, 0.998},   Row{12, 6.0, 0.0174}, Row{12, 7.0, 0.881},
        Row{12, 8.0, 0.997},  Row{18, 8.5, 0.000},  Row{18, 9.5, 0.623},  Row{18, 10.5, 0.985},
        Row{24, 12.0, 0.000}, Row{24, 13.0, 0.495}, Row{24, 14.0, 0.974}, Row{36, 15.5, 0.012},
        Row{36, 16.5, 0.818}, Row{36, 17.5, 0.993}, Row{48, 20.0, 0.000}, Row{48, 21.0, 0.649},
        Row{48, 22.0, 0.983}, Row{54, 21.0, 0.000}, Row{54, 22.0, 0.410}, Row{54, 23.0, 0.958},
        Row{54, 24.0, 0.999}}) {
    EXPECT_NEAR(1.0 - frame_error_ratio(row.rate_Mbps, 16'000, row.snr_db), row.success, 0.001)
        << row.rate_Mbps << " at " << row.snr_db;
  }
}

/// Bits in error of all ways out of the all-zero state of the code (133, 171) and back, by the
/// number of coded bits in which they differ: a[i], b[i] say which coded bits of bit i are sent.
std::map<int, double> weights_of(const std::vector<bool>& a, const std::vector<bool>& b,
                                 int longest) {
  struct Ways {
    double number = 0.0, errors = 0.0;
  };
  using ByDistance = std::map<int, Ways>;
  std::map<int, double> weights;
  for (std::size_t start = 0; start < a.size(); ++start) {
    std::vector<ByDistance> now(64);
    bool any = true;
    for (std::size_t i = start; any; ++i) {
      const std::size_t phase = i % a.size();
      std::vector<ByDistance> next(64);
      any = false;
      const auto go = [&](unsigned state, unsigned bit, int distance, const Ways& ways) {
        const unsigned memory = bit << 6 | state;
        if (a[phase]) distance += std::popcount(memory & 0133U) & 1;
        if (b[phase]) distance += std::popcount(memory & 0171U) & 1;
        if (distance > longest) return;
        const Ways on{ways.number, ways.errors + bit * ways.number};
        if (memory >> 1 == 0) {
          weights[distance] += on.errors;
          return;
        }
        Ways& sum = next[memory >> 1][distance];
        sum.number += on.number;
        sum.errors += on.errors;
        any = true;
      };
      if (i == start) go(0, 1, 0, {1.0, 0.0});
      for (unsigned state = 1; state < 64; ++state) {
        for (const auto& [distance, ways] : now[state]) {
          for (const unsigned bit : {0U, 1U}) go(state, bit, distance, ways);
        }
      }
      now = std::move(next);
    }
  }
  return weights;
}

/// The formula with these weights.
double by_formula(const std::map<int, double>& weights, int k, double coded_error, int bits) {
  double sum = 0.0;
  for (const auto& [d, weight] : weights) {
    sum += weight * std::pow(4.0 * coded_error * (1.0 - coded_error), 0.5 * d) / (2.0 * k);
  }
  return 1.0 - std::pow(1.0 - sum, bits);
}

// The standard's generators and what it does not send (802.11-2016, figure 17-9), all ways counted:
// longer ones than these matter only where nearly all frames are lost.
TEST(OfdmErrors, AreThoseOfTheStandardsCode) {
  const auto half = weights_of({true}, {true}, 18);
  const auto two_thirds = weights_of({true, true}, {true, false}, 12);
  const auto three_quarters = weights_of({true, true, false}, {true, false, true}, 11);
  EXPECT_EQ(half.at(10), 36.0);
  EXPECT_EQ(two_thirds.at(6), 3.0);
  EXPECT_EQ(three_quarters.at(5), 42.0);
  const auto s = [](double snr_db) { return std::pow(10.0, 0.1 * snr_db); };
  constexpr int kBits = 1000;
  for (const double above_db : {0.0, 1.0, 2.0}) {
    const double at_6_db = 5.0 + above_db, at_48_db = 22.0 + above_db, at_54_db = 23.0 + above_db;
    const double bpsk = by_formula(half, 1, 0.5 * std::erfc(std::sqrt(s(at_6_db))), kBits);
    EXPECT_NEAR(frame_error_ratio(6, kBits, at_6_db), bpsk, 0.01 * bpsk + 1e-12);
    const auto qam64 = [s](double db) {
      return 7.0 / 12.0 * 0.5 * std::erfc(std::sqrt(s(db) / 42));
    };
    const double at_48 = by_formula(two_thirds, 2, qam64(at_48_db), kBits);
    EXPECT_NEAR(frame_error_ratio(48, kBits, at_48_db), at_48, 0.01 * at_48 + 1e-12);
    const double at_54 = by_formula(three_quarters, 3, qam64(at_54_db), kBits);
    EXPECT_NEAR(frame_error_ratio(54, kBits, at_54_db), at_54, 0.01 * at_54 + 1e-12);
  }
}

TEST(OfdmErrors, FallWithTheSignalAndGrowWithTheFrame) {
  for (const double rate_Mbps : kOfdmRates_Mbps) {
    double before = 1.0;
    for (double snr_db = -10.0; snr_db < 40.0; snr_db += 0.1) {
      const double now = frame_error_ratio(rate_Mbps, 1000, snr_db);
      EXPECT_LE(now, before);
      EXPECT_GE(frame_error_ratio(rate_Mbps, 8000, snr_db), now);
      before = now;
    }
    EXPECT_EQ(frame_error_ratio(rate_Mbps, 1000, -10.0), 1.0);
    EXPECT_LT(before, 1e-12);
  }
}

TEST(OfdmErrors, LetTheBestRateLoseNoMoreThanAsked) {
  double before = 0.0;
  for (double snr_db = -5.0; snr_db < 40.0; snr_db += 0.1) {
    const double rate = best_rate_mbps(54, 1000, snr_db, 0.01);
    EXPECT_GE(rate, before);
    EXPECT_TRUE(rate == 6.0 || frame_error_ratio(rate, frame_bits(1000), snr_db) <= 0.01);
    before = rate;
  }
  EXPECT_EQ(before, 54.0);
  EXPECT_EQ(best_rate_mbps(24, 1000, 40.0, 0.01), 24.0);
  EXPECT_EQ(best_rate_mbps(54, 1000, -5.0, 0.01), 6.0);
}

}  // namespace
}  // namespace tether
