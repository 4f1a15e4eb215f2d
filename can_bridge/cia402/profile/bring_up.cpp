#include "can_bridge/cia402/profile/bring_up.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace tether::cia402 {
namespace {

using Verdict = StandstillInquiry::Verdict;

/// How long securing may take: enough for slow brakes, too.
constexpr Duration kSecureTimeout = std::chrono::seconds(5);
/// How long a drive that was lost at speed is left to its own watchdog before it is reset.
constexpr Duration kBlindBraking = std::chrono::seconds(2);

/// How long a drive that left its requests unanswered is asked once more before it counts as
/// absent: the last of those requests was sent before, and it may have been heard again since.
constexpr Duration kAskedOnceMore = std::chrono::milliseconds(100);

/// The bridge itself stood still for this long, so that it asks again whether wheels stand.
constexpr Duration kSuspended = std::chrono::milliseconds(200);

/// One and a half periods: each living drive's heartbeat falls into it.
Duration listening_time(const Cia402Config& config) {
  return std::chrono::milliseconds(config.drive_heartbeat_ms) * 3 / 2;
}

}  // namespace

void BringUp::begin() {
  begun_ = true;
  d_.nodes.begin_inquiry(d_.commanding);
  d_.commanding = d_.nodes.any_running();
  d_.axes.hold();
  d_.stage.enter(d_.nodes.any_heard() ? Stage::securing : Stage::listening);
}

void BringUp::tick(Instant now, std::vector<CanFrame>& nmt, std::vector<CanFrame>& service) {
  if (begun_) note_lost_nodes(now);
  begun_ = false;
  if (ticked_ && now - *ticked_ >= kSuspended) {
    for (Node& node : d_.nodes) node.begin_inquiry();
    if (d_.stage.stage() == Stage::configuring && !d_.nodes.any_reset()) {
      d_.stage.enter(Stage::securing);
    }
  }
  ticked_ = now;
  switch (d_.stage.stage()) {
    case Stage::listening:
      listen(now);
      break;
    case Stage::securing:
      secure(now, nmt, service);
      break;
    case Stage::configuring:
      configure(now, nmt, service);
      break;
    case Stage::beating:
      if (d_.heartbeat.beats() >= 2) start_nodes(now, nmt);
      break;
    case Stage::activating:
      activate(now, nmt);
      break;
    case Stage::settling:
      settle(now);
      break;
    default:
      break;
  }
}

void BringUp::note_lost_nodes(Instant now) {
  for (Node& node : d_.nodes) {
    node.lost = false;
    for (std::size_t i = 0; i < d_.axes.size(); ++i) {
      node.lost = node.lost || (d_.axes[i].node() == node.id && d_.axes.in_doubt(i, now));
    }
  }
}

void BringUp::listen(Instant now) {
  if (d_.nodes.any_heard() || d_.stage.elapsed(now) >= listening_time(d_.config)) {
    d_.stage.enter(Stage::securing);
  }
  d_.commanding = d_.nodes.any_running();
}

void BringUp::recall(Node& node, Instant now, std::vector<CanFrame>& nmt) {
  if (!node.may_be_stopped()) return;
  if (node.newest_recalled && now - *node.newest_recalled < Drives::kRecall) return;
  if (!node.recalled) node.recalled = now;
  node.newest_recalled = now;
  nmt.push_back(canopen::nmt_frame(canopen::NmtCommand::pre_operational, node.id));
}

bool BringUp::has_been_recalled(const Node& node, Instant now) const {
  return node.recalled &&
         now - *node.recalled >= std::chrono::milliseconds(d_.config.sdo_timeout_ms);
}

void BringUp::secure(Instant now, std::vector<CanFrame>& nmt, std::vector<CanFrame>& service) {
  d_.commanding = d_.commanding || d_.nodes.any_running();
  bool all_safe = d_.stage.elapsed(now) >= listening_time(d_.config);
  bool all_known = true;
  if (!d_.commanding) d_.axes.command_stop(now);
  for (Node& node : d_.nodes) {
    node.inquiry.tick(now, d_.axes.sdo_stop_words(), service);
    d_.axes.on_news(node.inquiry.take_news(), now);
    recall(node, now, nmt);
    all_safe = all_safe && may_be_reset(node, now);
    all_known = all_known && node.inquiry.verdict() != Verdict::unknown;
  }
  if (all_safe) {
    take_up_positions(now);
    begin_configuration(now);
  } else if (all_known && d_.stage.elapsed(now) >= kSecureTimeout) {
    d_.refuse(turning_text(now));
  }
}

void BringUp::take_up_positions(Instant now) {
  for (std::size_t i = 0; i < d_.axes.size(); ++i) {
    const Node& node = d_.nodes.of(d_.axes[i].node());
    if (!node.heard || node.inquiry.verdict() != Verdict::standing) continue;
    if (const auto position = node.inquiry.position(i)) d_.axes[i].take_up(*position, now);
  }
}

bool BringUp::may_be_reset(const Node& node, Instant now) const {
  // A fresh witness that turns outweighs whatever else is said, or not said.
  if (d_.axes.turning_of(node.id, now)) return false;
  switch (node.inquiry.verdict()) {
    case Verdict::standing:
      return d_.axes.believes_standstill(now) && d_.axes.can_have_stopped(node.id);
    case Verdict::unconfirmed:
      return d_.stage.elapsed(now) >= kSecureTimeout;
    case Verdict::unknown:
    case Verdict::turning:
      return false;
    case Verdict::silent:
      break;
  }
  if (!node.heard) {
    return has_been_recalled(node, now) && can_have_stopped(node) &&
           now - node.inquiry.silent_since().value_or(now) >= kAskedOnceMore &&
           (!node.lost || d_.stage.elapsed(now) >= kBlindBraking);
  }
  // It runs, so that its silence says nothing of its wheel: only its feedback does.
  for (std::size_t i = 0; i < d_.axes.size(); ++i) {
    if (d_.axes[i].node() != node.id) continue;
    if (!d_.axes[i].fresh(now) || !d_.axes.released(i) || !d_.axes.stands(i, now)) return false;
  }
  return true;
}

bool BringUp::can_have_stopped(const Node& node) const {
  // A wheel that turned without power is stopped by no watchdog.
  return d_.axes.can_have_stopped(node.id) &&
         std::ranges::none_of(d_.axes, [&node](const Axis& axis) {
           return axis.node() == node.id && axis.turned() && is_power_off(axis.state());
         });
}

std::string BringUp::turning_text(Instant now) const {
  std::string all;
  for (const Node& node : d_.nodes) {
    if (may_be_reset(node, now)) continue;
    std::string name = node.name;
    if (!all.empty()) all += "; ";
    if (node.inquiry.verdict() == Verdict::silent && !d_.axes.turning_of(node.id, now)) {
      all += name +
             ": answers no SDO request, and no feedback says that its wheel stands: see that "
             "it does, then switch the drive off and on";
      continue;
    }
    double speed_radps = 0.0;
    if (const auto& wheel = node.inquiry.fastest()) {
      name = d_.axes[wheel->axis].name();
      speed_radps = wheel->speed_radps;
    }
    if (node.inquiry.verdict() != Verdict::turning) {
      for (const Axis& axis : d_.axes) {
        if (axis.node() == node.id) speed_radps = axis.fastest_radps(now).value_or(speed_radps);
      }
    }
    all += fmt::format("{}: still turns at {:.2f} m/s after {:g} s: check its brake and load", name,
                       speed_radps * d_.axes.wheel_radius_m(), to_seconds(kSecureTimeout));
  }
  return all + "; no drive is reset while its wheel may turn, the stop stays commanded";
}

void BringUp::begin_configuration(Instant now) {
  d_.commanding = false;
  d_.axes.begin(now);
  d_.nodes.begin_startup();
  d_.stage.enter(Stage::configuring);
}

void BringUp::configure(Instant now, std::vector<CanFrame>& nmt, std::vector<CanFrame>& service) {
  for (Node& node : d_.nodes) start_up(node, now, nmt, service);
  if (std::string refusals = d_.nodes.refusals(); !refusals.empty()) {
    d_.refuse(std::move(refusals));
  } else if (d_.nodes.started_up()) {
    d_.heartbeat.restart_count();
    d_.stage.enter(Stage::beating);
  }
}

void BringUp::start_up(Node& node, Instant now, std::vector<CanFrame>& nmt,
                       std::vector<CanFrame>& service) {
  const bool again = node.startup.wants_reset_again();
  if (again) {
    node.inquiry.tick(now, d_.axes.sdo_stop_words(), service);
    d_.axes.on_news(node.inquiry.take_news(), now);
    recall(node, now, nmt);
  }
  node.startup.tick(now, service, !again || may_be_reset(node, now));
  // Its wheel may have begun to turn since it was asked before the first reset.
  if (!again && node.startup.wants_reset_again()) node.begin_inquiry();
}

void BringUp::start_nodes(Instant now, std::vector<CanFrame>& nmt) {
  d_.nodes.forget_states();
  for (const Node& node : d_.nodes) {
    nmt.push_back(canopen::nmt_frame(canopen::NmtCommand::start, node.id));
  }
  nmt_start_at_ = now;
  d_.commanding = true;
  d_.axes.hold();
  d_.stage.enter(Stage::activating);
}

void BringUp::activate(Instant now, std::vector<CanFrame>& nmt) {
  const bool operational = d_.nodes.all_operational();
  if (operational && d_.axes.fresh(now)) {
    d_.stage.enter(Stage::settling);
    return;
  }
  if (d_.stage.elapsed(now) >= d_.step_timeout() + d_.heartbeat_timeout()) {
    d_.refuse(waiting_for(now) + (operational ? "" : ": check the CAN wiring"));
    return;
  }
  // The frame may have been lost.
  if (now - nmt_start_at_ >= d_.heartbeat_timeout()) {
    nmt_start_at_ = now;
    for (const Node& node : d_.nodes) {
      if (node.operational()) continue;
      nmt.push_back(canopen::nmt_frame(canopen::NmtCommand::start, node.id));
    }
  }
}

void BringUp::settle(Instant now) {
  bool ready = true;
  for (std::size_t i = 0; i < d_.axes.size(); ++i) {
    const Axis& axis = d_.axes[i];
    if (axis.age(now) >= d_.step_timeout()) {
      d_.refuse(d_.axes.feedback_text(i));
      return;
    }
    ready = ready && axis.fresh(now) && d_.axes.stands(i, now) && axis.confirmed_off();
  }
  if (!ready) return;
  d_.axes.release();
  d_.stage.enter(Stage::standby);
}

std::string BringUp::waiting_for(Instant now) const {
  switch (d_.stage.stage()) {
    case Stage::idle:
      return "not started";
    case Stage::listening:
      return "listening for drives that are running already";
    case Stage::securing:
      return d_.nodes.any_heard() ? "braking drives that are running already"
                                  : "asking the drives whether their wheels stand";
    case Stage::configuring:
      return d_.nodes.progress();
    case Stage::beating:
      return "letting the drives know the bridge's heartbeat";
    case Stage::activating:
      for (const Node& node : d_.nodes) {
        if (!node.operational()) return node.name + ": not operational after NMT start";
      }
      break;
    case Stage::clearing:
      return "resetting the drives' faults";
    default:
      break;
  }
  return not_settled(now);
}

std::string BringUp::not_settled(Instant now) const {
  for (std::size_t i = 0; i < d_.axes.size(); ++i) {
    const Axis& axis = d_.axes[i];
    if (!axis.fresh(now)) return d_.axes.feedback_text(i);
    if (!d_.axes.stands(i, now)) return axis.name() + ": waiting until its wheel stands";
    if (!axis.confirmed_off()) {
      return fmt::format("{}: in {}, waiting until its power stage is off", axis.name(),
                         canopen::to_string(axis.state()));
    }
  }
  return "checking that the wheels stand";
}

}  // namespace tether::cia402
