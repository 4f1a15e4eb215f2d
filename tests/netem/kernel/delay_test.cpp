#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/base/random.hpp"
#include "tests/netem/kernel/qdisc.hpp"
#include "tests/netem/kernel/rig.hpp"
#include "tests/netem/kernel/udp_probe.hpp"
#include "tests/netem/link/two_sample.hpp"

// tc's laws of delay in the kernel against ours. The kernel releases a packet when its timer has
// gone off and the machine has time, so ours are put through the same machine before they are
// compared: as late as those packets with a constant delay that no pause of the machine held up,
// and then, as the kernel's, not before the end of a pause. All laws take turns within one run,
// because how late a machine is changes with what else it does.

namespace tether::test {
namespace {

constexpr std::size_t kLanes = 3;
constexpr std::size_t kPackets = 50'000;  // packets of each lane
constexpr double kDelay_ms = 20.0;
constexpr double kUniform_ms = 5.0;  // the law's half width
constexpr double kNormal_ms = 4.0;   // its standard deviation: tc's table ends at −4 of them
enum Lane : std::size_t { kConstant, kUniform, kNormal };

std::vector<std::string> constant(double delay_ms) {
  return {fmt::format("delay_ms={}", delay_ms)};
}

std::vector<std::string> uniform(double delay_ms, double half_width_ms) {
  return {fmt::format("delay_ms={}", delay_ms), "jitter.law=uniform",
          fmt::format("jitter.sd_ms={}", half_width_ms / std::numbers::sqrt3)};
}

std::vector<std::string> normal(double delay_ms, double sd_ms) {
  return {fmt::format("delay_ms={}", delay_ms), "jitter.law=normal",
          fmt::format("jitter.sd_ms={}", sd_ms)};
}

struct KernelDelay : ::testing::Test {
  static void SetUpTestSuite();
  void SetUp() override {
    ASSERT_EQ(run.received(), static_cast<std::int64_t>(kLanes * kPackets));
    ASSERT_GE(lateness(kDelay_ms).size(), 1000U) << "this machine paused all the time";
  }
  /// In ms, as the kernel delayed the packets of the lane.
  static std::vector<double> kernel(Lane lane);
  /// How much later than after `delay_ms` the kernel released packets with a constant delay, of
  /// those that no pause held up. In ms.
  static std::vector<double> lateness(double delay_ms);
  /// In ms, ours, with the pauses and the lateness of the machine.
  static std::vector<double> ours(Lane lane, const std::vector<std::string>& keys);

  static void expect_same(const std::string& name, Lane lane, const std::vector<std::string>& keys);
  static void expect_other(const std::string& what, Lane lane,
                           const std::vector<std::string>& keys);

  static KernelRun run;
};

KernelRun KernelDelay::run;

void KernelDelay::SetUpTestSuite() {
  LoQdiscs qdiscs;
  qdiscs.add(kPriorities);
  qdiscs.add(fmt::format("parent 1:1 handle 10: netem limit 100000 delay {}ms", kDelay_ms));
  qdiscs.add(fmt::format("parent 1:2 handle 20: netem limit 100000 delay {}ms {}ms", kDelay_ms,
                         kUniform_ms));
  qdiscs.add(
      fmt::format("parent 1:3 handle 30: netem limit 100000 delay {}ms {}ms distribution normal",
                  kDelay_ms, kNormal_ms));
  run = UdpProbe().send_paced(kLanes * kPackets, std::chrono::microseconds{200}, kLanes);
  const auto counts = qdiscs.counts();
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    const QdiscCounts& here = counts.at(fmt::format("{}0:", lane + 1));
    expect_all_accounted_for(here, kPackets, run.received(lane, kLanes));
    EXPECT_EQ(here.dropped, 0);
  }
  std::int64_t paused_ns = 0;
  for (const Pause& p : run.pauses) paused_ns += p.end_ns - p.begin_ns;
  const std::int64_t took_ns = run.sent_ns.back() - run.sent_ns.front();
  fmt::print("{:.1f} s, {:.2f} % of them in pauses\n", static_cast<double>(took_ns) * 1e-9,
             100.0 * static_cast<double>(paused_ns) / static_cast<double>(took_ns));
}

double to_ms(std::int64_t ns) { return static_cast<double>(ns) * 1e-6; }

std::vector<double> KernelDelay::kernel(Lane lane) {
  std::vector<double> delays_ms;
  for (std::size_t i = lane; i < run.sent_ns.size(); i += kLanes) {
    delays_ms.push_back(to_ms(run.after_pause(run.received_ns[i]) - run.sent_ns[i]));
  }
  return delays_ms;
}

/// When packets leave our link that come as those of the lane did.
std::vector<std::int64_t> due_ns(const KernelRun& run, Lane lane,
                                 const std::vector<std::string>& keys) {
  Link link = our_link(keys, 1);
  std::vector<std::int64_t> departures_ns;
  for (std::size_t i = lane; i < run.sent_ns.size(); i += kLanes) {
    const Instant sent = kStart + Duration{run.sent_ns[i] - run.sent_ns[0]};
    departures_ns.push_back(run.sent_ns[i] + (link.push(sent, {"X", {}}) - sent).count());
    link.pop_ready(sent, [](const Packet&) {});
  }
  return departures_ns;
}

std::vector<double> KernelDelay::lateness(double delay_ms) {
  std::vector<double> late_ms;
  std::size_t i = kConstant;
  for (const std::int64_t due : due_ns(run, kConstant, constant(delay_ms))) {
    const std::int64_t received = run.received_ns[i];
    const bool held_up = run.after_pause(due) != due || run.after_pause(received) != received;
    if (!held_up) late_ms.push_back(to_ms(received - due));
    i += kLanes;
  }
  return late_ms;
}

std::vector<double> KernelDelay::ours(Lane lane, const std::vector<std::string>& keys) {
  const std::vector<double> late_ms = lateness(kDelay_ms);
  RandomEngine random(1);
  std::vector<double> delays_ms;
  std::size_t i = lane;
  for (const std::int64_t due : due_ns(run, lane, keys)) {
    const auto late_ns = std::llround(1e6 * late_ms[random() % late_ms.size()]);
    delays_ms.push_back(to_ms(run.after_pause(due + late_ns) - run.sent_ns[i]));
    i += kLanes;
  }
  return delays_ms;
}

double quantile(std::vector<double> values, double p) {
  const auto at = values.begin() + std::lround(p * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

void print(const std::string& name, const std::vector<double>& ms) {
  fmt::print("| {} |", name);
  for (const double p : {0.001, 0.01, 0.1, 0.5, 0.9, 0.99})
    fmt::print(" {:.3f} |", quantile(ms, p));
  fmt::print("\n");
}

void KernelDelay::expect_same(const std::string& name, Lane lane,
                              const std::vector<std::string>& keys) {
  const KolmogorovSmirnov found = same_law(kernel(lane), ours(lane, keys));
  print(name + ", kernel", kernel(lane));
  print(name + ", ours", ours(lane, keys));
  fmt::print("  D = {:.4f}, p = {:.2g}\n", found.distance, found.probability);
  EXPECT_GT(found.probability, kLevel);
}

void KernelDelay::expect_other(const std::string& what, Lane lane,
                               const std::vector<std::string>& keys) {
  const KolmogorovSmirnov found = same_law(kernel(lane), ours(lane, keys));
  fmt::print("  {}: D = {:.4f}, p = {:.2g}\n", what, found.distance, found.probability);
  EXPECT_LT(found.probability, kLevel) << what << " is not noticed";
}

TEST_F(KernelDelay, OfAConstantIsNeverShorterAndHardlyLonger) {
  const auto right = [](double delay_ms) {
    const std::vector<double> late_ms = lateness(delay_ms);
    return quantile(late_ms, 0.0) >= 0.0 && quantile(late_ms, 0.5) < 0.5;
  };
  print("constant, kernel", kernel(kConstant));
  print("constant, ours", ours(kConstant, constant(kDelay_ms)));
  print(fmt::format("  {} not held up, late by", lateness(kDelay_ms).size()), lateness(kDelay_ms));
  EXPECT_TRUE(right(kDelay_ms));
  EXPECT_FALSE(right(0.95 * kDelay_ms));
  EXPECT_FALSE(right(1.05 * kDelay_ms));
}

TEST_F(KernelDelay, WithJitterIsUniformAsOurs) {
  expect_same("uniform", kUniform, uniform(kDelay_ms, kUniform_ms));
  expect_other("jitter 20 % larger", kUniform, uniform(kDelay_ms, 1.2 * kUniform_ms));
  expect_other("delay 5 % larger", kUniform, uniform(1.05 * kDelay_ms, kUniform_ms));
  expect_other("normal with the same spread", kUniform,
               normal(kDelay_ms, kUniform_ms / std::numbers::sqrt3));
}

TEST_F(KernelDelay, OfTcsNormalTableIsNormalAsOurs) {
  expect_same("normal", kNormal, normal(kDelay_ms, kNormal_ms));
  expect_other("jitter 20 % larger", kNormal, normal(kDelay_ms, 1.2 * kNormal_ms));
  expect_other("delay 5 % larger", kNormal, normal(1.05 * kDelay_ms, kNormal_ms));
  expect_other("uniform with the same spread", kNormal,
               uniform(kDelay_ms, kNormal_ms * std::numbers::sqrt3));
}

}  // namespace
}  // namespace tether::test
