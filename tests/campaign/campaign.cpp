#include "tests/campaign/campaign.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <future>
#include <tether/drivetrain_state_t.hpp>
#include <vector>

namespace tether::campaign {
namespace {

/// Runs seeds from `next` on until they are used up.
Totals work(const Setup& setup, const Campaign& campaign, std::atomic<std::uint64_t>& next) {
  Totals totals;
  for (std::uint64_t k = next++; k < campaign.runs; k = next++) {
    const std::uint64_t seed = campaign.first_seed + k;
    totals.add(seed, run_trial(setup, with_vehicle(draw_trial(seed)), false));
  }
  return totals;
}

using State = drivetrain_state_t;
using std::chrono::milliseconds;

constexpr Duration kBetweenFaults = milliseconds(40);
constexpr Instant kDisarm = kStart + std::chrono::seconds{6};
constexpr double kCoast_mps2 = 0.3;

std::uint64_t kinds() { return fault_rows().size(); }

/// A drive of 7 s: armed as soon as possible, disarmed at kDisarm.
Trial quiet_drive(bool plans, bool coasts) {
  Trial t;
  t.seed = 41;
  t.plans = plans;
  t.max_speed_mps = 1.5;
  t.brake = !coasts;
  t.coast_mps2 = kCoast_mps2;
  t.faults.push_back({FaultKind::disarm, kDisarm, kDisarm, 0.0, 1});
  t.quiet = kStart + std::chrono::seconds{8};
  t.end = t.quiet + std::chrono::seconds{coasts ? 9 : 4};
  return t;
}

template <class Condition>
Instant first(const Record& record, Instant from, const Condition& condition) {
  for (const StateSample& s : record.states) {
    if (s.when >= from && condition(s)) return s.when;
  }
  return record.end;
}

Fault fault_at(FaultKind kind, Instant when, int node) {
  const FaultRow& row = row_of(kind);
  const Duration length = from_seconds((row.shortest_s + row.longest_s) / 2.0);
  constexpr double kShare = 0.75;
  return {kind, when, when + length, kShare, node};
}

const char* to_string(Phase phase) {
  constexpr const char* kNames[] = {"starting", "disarmed", "arming",  "accelerating",
                                    "driving",  "braking",  "standing"};
  return kNames[static_cast<std::size_t>(phase)];
}

}  // namespace

Totals run_campaign(const Setup& setup, const Campaign& campaign,
                    const std::function<void(std::uint64_t)>& progress) {
  std::atomic<std::uint64_t> next{0};
  std::vector<std::future<Totals>> parts;
  for (unsigned t = 0; t < campaign.threads; ++t) {
    parts.push_back(std::async(std::launch::async, [&] { return work(setup, campaign, next); }));
  }
  Totals totals;
  for (std::future<Totals>& part : parts) {
    while (part.wait_for(std::chrono::seconds{5}) == std::future_status::timeout) {
      if (progress) progress(std::min(next.load(), campaign.runs));
    }
    totals.add(part.get());
  }
  return totals;
}

Enumeration::Enumeration(const Setup& setup, bool pairs) : pairs_(pairs) {
  const std::uint64_t combinations = pairs ? kinds() * (kinds() + 1) / 2 * 2 : kinds() * 4;
  size_ = combinations * kPhases;
  for (const bool plans : {false, true}) {
    const Record record = run_trial(setup, quiet_drive(plans, false), false);
    auto& at = phases_.at(plans ? 1 : 0);
    const auto is = [](std::int32_t state) {
      return [state](const StateSample& s) { return s.state == state; };
    };
    const auto moves = [](double least_mps) {
      return [least_mps](const StateSample& s) { return std::abs(s.twist.v_mps) >= least_mps; };
    };
    at[0] = kStart + milliseconds(800);
    at[1] = first(record, kStart, is(State::DISARMED)) + milliseconds(30);
    at[2] = first(record, kStart, is(State::ARMING)) + milliseconds(300);
    at[3] = first(record, kStart, moves(0.1)) + milliseconds(50);
    at[4] = at[3] + milliseconds(1000);
    at[5] = kDisarm + milliseconds(60);
    at[6] = first(record, kDisarm, is(State::DISARMED)) + milliseconds(30);
  }
}

Enumeration::Case Enumeration::at(std::uint64_t number) const {
  Case c;
  c.phase = static_cast<Phase>(number % kPhases);
  std::uint64_t rest = number / kPhases;
  if (!pairs_) {
    c.coasts = rest % 2 == 1;
    c.plans = rest / 2 % 2 == 1;
    c.first = c.second = static_cast<FaultKind>(rest / 4);
    return c;
  }
  c.same_node = rest % 2 == 0;
  rest /= 2;
  c.coasts = rest % 2 == 1;
  c.plans = rest / 2 % 2 == 1;
  std::uint64_t row = 0;
  while (rest >= kinds() - row) rest -= kinds() - row++;
  c.first = static_cast<FaultKind>(row);
  c.second = static_cast<FaultKind>(row + rest);
  return c;
}

Trial Enumeration::trial(std::uint64_t number) const {
  const Case c = at(number);
  Trial t = quiet_drive(c.plans, c.coasts);
  const Instant when = phases_.at(c.plans ? 1 : 0).at(static_cast<std::size_t>(c.phase));
  t.faults.push_back(fault_at(c.first, when, 1));
  if (pairs_) t.faults.push_back(fault_at(c.second, when + kBetweenFaults, c.same_node ? 1 : 2));
  return t;
}

std::string Enumeration::name(std::uint64_t number) const {
  const Case c = at(number);
  const std::string second = pairs_ ? fmt::format(" + {} of the {} drive", row_of(c.second).name,
                                                  c.same_node ? "same" : "other")
                                    : "";
  return fmt::format("{}{} while {} ({}, {})", row_of(c.first).name, second, to_string(c.phase),
                     c.plans ? "plans" : "twists", c.coasts ? "coasts" : "brakes");
}

Totals run_enumeration(const Setup& setup, const Enumeration& enumeration, unsigned threads) {
  std::atomic<std::uint64_t> next{0};
  const auto work = [&] {
    Totals totals;
    for (std::uint64_t k = next++; k < enumeration.size(); k = next++) {
      totals.add(k, run_trial(setup, enumeration.trial(k), false));
    }
    return totals;
  };
  std::vector<std::future<Totals>> parts;
  for (unsigned t = 0; t < threads; ++t) parts.push_back(std::async(std::launch::async, work));
  Totals totals;
  for (std::future<Totals>& part : parts) totals.add(part.get());
  return totals;
}

}  // namespace tether::campaign
