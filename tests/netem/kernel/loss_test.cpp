#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <ostream>

#include "tests/netem/kernel/qdisc.hpp"
#include "tests/netem/kernel/rig.hpp"
#include "tests/netem/kernel/udp_probe.hpp"
#include "tests/netem/link/loss_statistics.hpp"
#include "tests/netem/link/two_sample.hpp"

// tc's loss models in the kernel against ours: the same laws, packet by packet.

namespace tether::test {
namespace {

constexpr std::size_t kPackets = 400'000;

struct Parameter {
  std::string key;
  double value = 0.0;
};

/// One of tc's loss models and ours with the same parameters.
struct LossCase {
  std::string tc;     ///< tc's words before the parameters in percent
  std::string model;  ///< ours
  std::string prefix;
  std::vector<Parameter> parameters;
};

LossCase random_loss(double p) { return {"loss random", "fixed", "", {{"loss", p}}}; }

LossCase gemodel(double p, double r, double one_minus_h, double one_minus_k) {
  return {"loss gemodel",
          "gilbert_elliott",
          "gilbert_elliott.",
          {{"p", p}, {"r", r}, {"one_minus_h", one_minus_h}, {"one_minus_k", one_minus_k}}};
}

LossCase four_state(double p13, double p31, double p32, double p23, double p14) {
  return {"loss state",
          "four_state",
          "four_state.",
          {{"p13", p13}, {"p31", p31}, {"p32", p32}, {"p23", p23}, {"p14", p14}}};
}

std::string tc_words(const LossCase& c) {
  std::string words = c.tc;
  for (const Parameter& p : c.parameters) words += fmt::format(" {:g}%", 100.0 * p.value);
  return words;
}

std::vector<bool> our_losses(const LossCase& c, std::uint64_t seed, std::size_t packets) {
  std::vector<std::string> keys{"model=" + c.model};
  for (const Parameter& p : c.parameters) {
    keys.push_back(fmt::format("{}{}={}", c.prefix, p.key, p.value));
  }
  Link link = our_link(keys, seed);
  std::vector<bool> lost;
  for (std::size_t i = 0; i < packets; ++i) {
    lost.push_back(link.push(kStart, {"X", {}}) == Instant::max());
    link.pop_ready(kStart, [](const Packet&) {});
  }
  return lost;
}

std::vector<bool> kernel_losses(const LossCase& c, std::size_t packets) {
  LoQdiscs qdiscs;
  qdiscs.add(kPriorities);
  qdiscs.add("parent 1:1 handle 10: netem " + tc_words(c));
  const KernelRun run = UdpProbe().send_burst(packets);
  expect_all_accounted_for(qdiscs.counts().at("10:"), static_cast<std::int64_t>(packets),
                           run.received());
  std::vector<bool> lost;
  for (const std::int64_t t : run.received_ns) lost.push_back(t == 0);
  return lost;
}

std::ostream& operator<<(std::ostream& out, const LossCase& c) { return out << tc_words(c); }

/// Standard deviation of the loss ratio over kPackets, by the model's formula.
double ratio_sd(const LossCase& c) {
  const auto v = [&](std::size_t i) { return c.parameters[i].value; };
  const auto statistics =
      c.model == "gilbert_elliott" ? LossStatistics::of(GilbertElliott{v(0), v(1), v(2), v(3)})
      : c.model == "four_state"    ? LossStatistics::of(FourState{v(0), v(1), v(2), v(3), v(4)})
                                   : LossStatistics::of(GilbertElliott{0.5, 0.5, v(0), v(0)});
  return statistics.value().loss_ratio_sd(static_cast<double>(kPackets));
}

/// [0]: lengths of gaps, runs of received packets; [1]: of bursts, runs of lost ones. The runs at
/// both ends do not count.
struct Runs {
  std::array<std::vector<std::int64_t>, 2> histogram;
  std::int64_t lost = 0;

  explicit Runs(const std::vector<bool>& fates) {
    lost = std::count(fates.begin(), fates.end(), true);
    std::size_t begin = 0;
    for (std::size_t i = 1; i < fates.size(); ++i) {
      if (fates[i] == fates[i - 1]) continue;
      auto& counts = histogram[fates[i - 1] ? 1 : 0];
      if (counts.size() <= i - begin) counts.resize(i - begin + 1);
      if (begin > 0) ++counts[i - begin];
      begin = i;
    }
  }

  double mean(std::size_t which) const {
    std::int64_t sum = 0, count = 0;
    for (std::size_t n = 0; n < histogram[which].size(); ++n) {
      count += histogram[which][n];
      sum += histogram[which][n] * static_cast<std::int64_t>(n);
    }
    return static_cast<double>(sum) / static_cast<double>(count);
  }
};

/// Lengths of successive runs are correlated where a state hides behind the fates, so that the
/// chi-square sum is larger than for independent samples: by so much, in pairs of our own.
std::array<double, 2> inflations(const LossCase& c) {
  constexpr int kPairs = 20;
  constexpr std::size_t kLength = 100'000;
  std::array<double, 2> mean{};
  for (std::uint64_t seed = 1000; seed < 1000 + 2 * kPairs; seed += 2) {
    const Runs first(our_losses(c, seed, kLength));
    const Runs second(our_losses(c, seed + 1, kLength));
    for (const std::size_t i : {0U, 1U}) {
      const ChiSquare found = same_histogram(first.histogram[i], second.histogram[i]);
      mean[i] += found.sum / found.degrees_of_freedom / kPairs;
    }
  }
  return {std::max(1.0, mean[0]), std::max(1.0, mean[1])};
}

/// How probable differences as large as these are between two runs of one law.
struct Probabilities {
  double ratio = 1.0, gaps = 1.0, bursts = 1.0;
  double least() const { return std::min({ratio, gaps, bursts}); }
};

struct Comparison {
  double ratio_sd;
  std::array<double, 2> inflation;

  explicit Comparison(const LossCase& c)
      : ratio_sd(tether::test::ratio_sd(c)), inflation(inflations(c)) {}

  Probabilities operator()(const Runs& first, const Runs& second) const {
    const auto same = [&](std::size_t i) {
      return same_histogram(first.histogram[i], second.histogram[i]).probability(inflation[i]);
    };
    const auto n = static_cast<std::int64_t>(kPackets);
    return {same_ratio(first.lost, second.lost, n, ratio_sd), same(0), same(1)};
  }
};

void print(const LossCase& c, const Comparison& comparison, const Runs& kernel, const Runs& ours,
           const Probabilities& p) {
  const auto percent = [](const Runs& runs) {
    return 100.0 * static_cast<double>(runs.lost) / static_cast<double>(kPackets);
  };
  fmt::print(
      "| `{}` | {:.3f} % | {:.3f} % | {:.3f} | {:.3f} | {:.3f} | {:.3f} | {:.2g}, {:.2g}, {:.2g} "
      "|\n"
      "  inflation {:.2f}, {:.2f}\n",
      tc_words(c), percent(kernel), percent(ours), kernel.mean(1), ours.mean(1), kernel.mean(0),
      ours.mean(0), p.ratio, p.bursts, p.gaps, comparison.inflation[0], comparison.inflation[1]);
}

struct KernelLoss : ::testing::TestWithParam<LossCase> {};

TEST_P(KernelLoss, HasTheSameRatioBurstsAndGapsAsOurs) {
  const LossCase& c = GetParam();
  const Comparison compare(c);
  const Runs kernel(kernel_losses(c, kPackets));
  const Runs ours(our_losses(c, 1, kPackets));
  const Probabilities p = compare(kernel, ours);
  print(c, compare, kernel, ours, p);
  EXPECT_GT(p.ratio, kLevel);
  EXPECT_GT(p.bursts, kLevel);
  EXPECT_GT(p.gaps, kLevel);

  for (std::size_t i = 0; i < c.parameters.size(); ++i) {
    LossCase wrong = c;
    double& value = wrong.parameters[i].value;
    if (value == 0.0 || value == 1.0) continue;
    value *= 1.2;
    const double found = compare(kernel, Runs(our_losses(wrong, 2, kPackets))).least();
    fmt::print("  {} 20 % larger: p = {:.2g}\n", wrong.parameters[i].key, found);
    EXPECT_LT(found, kLevel) << wrong.parameters[i].key << " 20 % larger is not noticed";
  }
}

INSTANTIATE_TEST_SUITE_P(Models, KernelLoss,
                         ::testing::Values(random_loss(0.1), gemodel(0.0625, 0.25, 1.0, 0.0),
                                           gemodel(0.05, 0.2, 0.8, 0.1),
                                           four_state(0.1, 0.3, 0.3, 0.5, 0.1)));

struct KernelSteps : ::testing::TestWithParam<LossCase> {};

TEST_P(KernelSteps, AreOursPacketByPacketWhereNothingIsLeftToChance) {
  // For the kernel 100 % is 1 − 2⁻³²: with 8 cases and 2 draws a packet, one in 4 million runs
  // differs.
  constexpr std::size_t kFew = 64;
  const std::vector<bool> kernel = kernel_losses(GetParam(), kFew);
  EXPECT_EQ(kernel, our_losses(GetParam(), 1, kFew));
  EXPECT_TRUE(kernel[0] != kernel[1]) << "says nothing of the order of step and loss";
}

INSTANTIATE_TEST_SUITE_P(Models, KernelSteps,
                         ::testing::Values(gemodel(1, 1, 1, 0), gemodel(1, 1, 0, 1),
                                           gemodel(1, 0, 1, 0), gemodel(1, 0, 0, 1),
                                           four_state(1, 0, 1, 1, 0), four_state(1, 1, 0, 0, 0),
                                           four_state(0, 0, 0, 0, 1), four_state(1, 0, 1, 0, 0)));

}  // namespace
}  // namespace tether::test
