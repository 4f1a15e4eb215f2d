// Cia402Profile: the stages from start() to standby.
#include <fmt/format.h>

#include <algorithm>

#include "can_bridge/canopen/canopen.hpp"
#include "can_bridge/cia402/profile.hpp"

namespace tether {
namespace {

using canopen::NmtState;
using Verdict = cia402::StandstillInquiry::Verdict;

/// For slow brakes, too.
constexpr Duration kSecureTimeout = std::chrono::seconds(5);
/// Of a running drive that says nothing about its wheel.
constexpr Duration kBlindBraking = std::chrono::seconds(2);

/// One and a half periods: each living drive's heartbeat falls into it.
Duration listening_time(const Cia402Config& config) {
  return std::chrono::milliseconds(config.drive_heartbeat_ms) * 3 / 2;
}

}  // namespace

void Cia402Profile::start(Instant) { restart(); }

void Cia402Profile::restart() {
  bool any_running = false, any_heard = false;
  for (Node& node : nodes_) {
    node.heard = node.state && node.state != NmtState::boot_up;
    node.running = commanding_ && node.state == NmtState::operational;
    any_heard = any_heard || node.heard;
    any_running = any_running || node.running;
    node.inquiry.begin();
  }
  commanding_ = any_running;
  released_ = {};
  needs_restart_ = false;
  fault_axis_.reset();
  enter(any_heard ? Stage::securing : Stage::listening);
}

void Cia402Profile::listen(Instant now) {
  if (std::ranges::any_of(nodes_, &Node::heard)) {
    enter(Stage::securing);
  } else if (in_stage(now) >= listening_time(config_)) {
    begin_configuration();
  }
  commanding_ = std::ranges::any_of(nodes_, &Node::running);
}

void Cia402Profile::secure(Instant now, std::vector<CanFrame>& service) {
  commanding_ = commanding_ || std::ranges::any_of(nodes_, &Node::running);
  bool all_safe = in_stage(now) >= listening_time(config_);
  bool all_known = true;
  for (Node& node : nodes_) {
    if (!node.heard) continue;
    node.inquiry.tick(now, service);
    all_safe = all_safe && may_be_reset(node, now);
    all_known = all_known && node.inquiry.verdict() != Verdict::unknown;
  }
  if (all_safe) {
    begin_configuration();
  } else if (all_known && in_stage(now) >= kSecureTimeout) {
    refuse(turning_text(now));
  }
}

bool Cia402Profile::may_be_reset(const Node& node, Instant now) const {
  const Verdict verdict = node.inquiry.verdict();
  if (verdict != Verdict::silent) return verdict == Verdict::standing;
  if (!node.running) return true;
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    if (axes_[i].node() != node.id) continue;
    const bool safe = axes_[i].fresh(now) ? released_[i] && axes_[i].standing(now)
                                          : in_stage(now) >= kBlindBraking;
    if (!safe) return false;
  }
  return true;
}

std::string Cia402Profile::turning_text(Instant now) const {
  std::string all;
  for (const Node& node : nodes_) {
    if (!node.heard || may_be_reset(node, now)) continue;
    std::string name = node.name;
    double speed_radps = 0.0;
    if (const auto& wheel = node.inquiry.fastest()) {
      name = axes_[wheel->axis].name();
      speed_radps = wheel->speed_radps;
    }
    if (node.inquiry.verdict() == Verdict::silent) {
      for (const cia402::Axis& axis : axes_) {
        if (axis.node() == node.id) speed_radps = axis.feedback().speed_radps;
      }
    }
    all += fmt::format("{}{}: still turns at {:.2f} m/s after {:g} s", all.empty() ? "" : "; ",
                       name, speed_radps * wheel_radius_m_, to_seconds(kSecureTimeout));
  }
  return all + ": check its brake and load; it is not reset while it turns, stop stays commanded";
}

void Cia402Profile::begin_configuration() {
  commanding_ = false;
  for (cia402::Axis& axis : axes_) axis.begin();
  for (Node& node : nodes_) {
    node.state.reset();
    node.heard = node.running = false;
    node.startup.begin();
  }
  enter(Stage::configuring);
}

void Cia402Profile::configure(Instant now, std::vector<CanFrame>& service) {
  bool all_done = true;
  std::string refusals;
  for (Node& node : nodes_) {
    node.startup.tick(now, service);
    all_done = all_done && node.startup.done();
    if (node.startup.refusal().empty()) continue;
    refusals += (refusals.empty() ? "" : "; ") + node.startup.refusal();
  }
  if (!refusals.empty()) {
    refuse(refusals);
  } else if (all_done) {
    beats_ = 0;
    enter(Stage::beating);
  }
}

void Cia402Profile::start_nodes(Instant now, std::vector<CanFrame>& nmt) {
  for (Node& node : nodes_) {
    node.state.reset();
    nmt.push_back(canopen::nmt_frame(canopen::NmtCommand::start, node.id));
  }
  nmt_start_at_ = now;
  commanding_ = true;
  released_ = {};
  enter(Stage::activating);
}

void Cia402Profile::activate(Instant now, std::vector<CanFrame>& nmt) {
  const bool operational = std::ranges::all_of(
      nodes_, [](const Node& node) { return node.state == NmtState::operational; });
  if (operational && all_fresh(now)) {
    enter(Stage::settling);
    return;
  }
  if (in_stage(now) >= step_timeout() + heartbeat_timeout()) {
    refuse(waiting_for(now) + (operational ? "" : ": check the CAN wiring"));
    return;
  }
  // The frame may have been lost.
  if (now - nmt_start_at_ >= heartbeat_timeout()) {
    nmt_start_at_ = now;
    for (const Node& node : nodes_) {
      if (node.state == NmtState::operational) continue;
      nmt.push_back(canopen::nmt_frame(canopen::NmtCommand::start, node.id));
    }
  }
}

void Cia402Profile::settle(Instant now) {
  bool ready = true;
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    const cia402::Axis& axis = axes_[i];
    if (axis.age(now) >= step_timeout()) {
      refuse(feedback_text(i));
      return;
    }
    ready = ready && axis.fresh(now) && axis.standing(now) && axis.confirmed_off();
  }
  if (!ready) return;
  released_ = {true, true};
  enter(Stage::standby);
}

std::string Cia402Profile::waiting_for(Instant now) const {
  switch (stage_) {
    case Stage::idle:
      return "not started";
    case Stage::listening:
      return "listening for drives that are running already";
    case Stage::securing:
      return "braking drives that are running already";
    case Stage::configuring: {
      std::string all;
      for (const Node& node : nodes_) {
        all += (all.empty() ? "" : "; ") + node.startup.progress();
      }
      return all;
    }
    case Stage::beating:
      return "letting the drives know the bridge's heartbeat";
    case Stage::activating:
      for (const Node& node : nodes_) {
        if (node.state != NmtState::operational) {
          return fmt::format("{}: not operational after NMT start", node.name);
        }
      }
      break;
    case Stage::clearing:
      return "resetting the drives' faults";
    default:
      break;
  }
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    const cia402::Axis& axis = axes_[i];
    if (!axis.fresh(now)) return feedback_text(i);
    if (!axis.standing(now)) return axis.name() + ": waiting until its wheel stands";
    if (!axis.confirmed_off()) {
      return fmt::format("{}: in {}, waiting until its power stage is off", axis.name(),
                         canopen::to_string(axis.state()));
    }
  }
  return "checking that the wheels stand";
}

}  // namespace tether
