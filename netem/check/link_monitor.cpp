#include "netem/check/link_monitor.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <utility>

namespace tether {

using Outcome = PacketFate::Outcome;

LinkMonitor::LinkMonitor(LinkExpectation expected) : expected_(std::move(expected)) {
  const std::size_t states = expected_.channel ? expected_.channel->states().size() : 0;
  if (states > 1) sojourns_.emplace(states);
}

void LinkMonitor::on_packet(const PacketFate& fate) {
  if (fate.arrival < kStart) return;
  if (sojourns_ && !expected_.moves_in_time) {
    sojourns_->enter(static_cast<std::size_t>(fate.state), static_cast<double>(packets_));
  }
  ++packets_;
  if (fate.outcome == Outcome::outage) {
    ++in_outages_;
    return;
  }
  loss_.add(fate.outcome == Outcome::lost, fate.arrival);
  if (fate.outcome == Outcome::under_way) delays_.add(fate.departure - fate.arrival);
  overflowed_ += fate.outcome == Outcome::overflowed ? 1 : 0;
}

void LinkMonitor::on_state(int state, Instant now) {
  if (wants_states()) sojourns_->enter(static_cast<std::size_t>(state), to_seconds(now));
}

std::vector<ChannelCheck> LinkMonitor::checks(Instant end,
                                              const ChannelCheckOptions& options) const {
  std::vector<ChannelCheck> checks;
  if (expected_.channel) {
    std::optional<SojournStatistics> sojourns = sojourns_;
    if (sojourns) {
      sojourns->advance(expected_.moves_in_time ? to_seconds(end) : static_cast<double>(packets_));
    }
    checks = compare_channel(*expected_.channel, loss_, delays_, sojourns ? &*sojourns : nullptr,
                             options);
  } else {
    checks = open_checks(options.shown_confidence);
  }
  leave_open(checks, options.shown_confidence);
  return checks;
}

std::vector<ChannelCheck> LinkMonitor::open_checks(double confidence) const {
  constexpr double kOpen = std::numeric_limits<double>::quiet_NaN();
  const LossSpread spread = loss_.estimated_spread();
  std::vector<ChannelCheck> checks{
      {"PRR", "", kOpen, loss_.prr(confidence, spread), Verdict::not_comparable, ""},
      {"mean loss burst", "packets", kOpen, loss_.mean_burst(confidence, spread),
       Verdict::not_comparable, ""},
      {"lag-1 correlation", "", kOpen, loss_.lag1_correlation(confidence, spread),
       Verdict::not_comparable, ""}};
  for (std::size_t i = 0; i < DelayStatistics::kQuantiles.size(); ++i) {
    const double q = DelayStatistics::kQuantiles[i];
    Estimate achieved = delays_.quantile(q, confidence, delays_.estimated_vif(i));
    for (double* x : {&achieved.value, &achieved.low, &achieved.high}) *x *= 1e3;
    checks.push_back({fmt::format("delay p{:.0f}", 100.0 * q), "ms", kOpen, achieved,
                      Verdict::not_comparable, ""});
  }
  return checks;
}

void LinkMonitor::leave_open(std::vector<ChannelCheck>& checks, double confidence) const {
  // Where the model predicts no value, it predicts no spread either.
  const std::vector<ChannelCheck> measured = open_checks(confidence);
  const auto open = [&measured](ChannelCheck& check, const std::string& reason) {
    if (reason.empty()) return;
    for (const ChannelCheck& m : measured) {
      if (m.quantity == check.quantity) check = m;
    }
    check.reason = reason;
  };
  for (ChannelCheck& check : checks) {
    const bool of_delay = check.quantity.starts_with("delay");
    const bool of_sojourn = check.quantity.starts_with("mean sojourn");
    if (of_sojourn) continue;
    if (of_delay) {
      if (overflowed_ > 0) open(check, fmt::format("{} packets found no room", overflowed_));
      open(check, expected_.no_delays);
      continue;
    }
    if (check.quantity != "PRR" && in_outages_ > 0) open(check, "outages cut bursts");
    if (check.quantity == "PRR" && overflowed_ + in_outages_ > 0) {
      check.reason = fmt::format("without {} packets in outages and {} for want of room",
                                 in_outages_, overflowed_);
    }
    open(check, expected_.no_losses);
  }
}

}  // namespace tether
