#include "tests/campaign/traffic.hpp"

#include <cmath>
#include <limits>
#include <tether/drive_request_t.hpp>
#include <tether/drivetrain_state_t.hpp>
#include <tether/plan_t.hpp>
#include <tether/twist_t.hpp>
#include <utility>

#include "common/node/message_io.hpp"

namespace tether::campaign {
namespace {

template <class LcmType>
std::vector<std::uint8_t> encoded(const LcmType& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

std::size_t pick(double share, std::size_t count) {
  return std::min(count - 1, static_cast<std::size_t>(share * static_cast<double>(count)));
}

}  // namespace

// ------------------------------------------------------------------------------------- network

Network::Network(const Trial& trial, EventLoop& loop, Bus& bus)
    : loop_(loop),
      bus_(bus),
      random_(random_stream(trial.seed, "network")),
      delay_s_(trial.delay_s) {}

void Network::begin(const Fault& fault) {
  if (fault.kind == FaultKind::loss) loss_ = 0.3 + 0.7 * fault.share;
  if (fault.kind == FaultKind::delay) extra_s_ = 0.6 * fault.share;
  if (fault.kind == FaultKind::duplicates) duplicates_ = 0.2 + 0.8 * fault.share;
}

void Network::end(const Fault& fault) {
  if (fault.kind == FaultKind::loss) loss_ = 0.0;
  if (fault.kind == FaultKind::delay) extra_s_ = 0.0;
  if (fault.kind == FaultKind::duplicates) duplicates_ = 0.0;
}

void Network::send(const std::string& channel, std::vector<std::uint8_t> bytes) {
  sent_.push_back({channel, std::move(bytes)});
  const Duration delay = from_seconds(delay_s_ + extra_s_ + 0.01 * uniform_01(random_));
  const bool lost = uniform_01(random_) < loss_;
  if (!lost) deliver_later(delay, sent_.back());
  if (uniform_01(random_) < duplicates_) {
    deliver_later(delay + from_seconds(0.1 * uniform_01(random_)), sent_.back());
  }
}

void Network::replay(double share) {
  if (!sent_.empty()) deliver_later(Duration{0}, sent_[pick(share, sent_.size())]);
}

void Network::deliver_later(Duration delay, const Sent& sent) {
  loop_.at(loop_.now() + delay, Priority::delivery,
           [this, sent](Instant) { bus_.publish(sent.channel, sent.bytes); });
}

// ---------------------------------------------------------------------------------- controller

Controller::Controller(const Trial& trial, const std::string& name, EventLoop& loop,
                       Network& network, const Heard& heard)
    : trial_(trial),
      loop_(loop),
      network_(network),
      heard_(heard),
      random_(random_stream(trial.seed, name)),
      session_(static_cast<std::int64_t>(1e6 * uniform_01(random_))) {}

void Controller::restart() {
  seq_ = 0;
  ++session_;
}

void Controller::choose_twist(Instant now) {
  if (now >= next_change_) {
    next_change_ = now + from_seconds(0.3 + 2.0 * uniform_01(random_));
    const double most = 1.2;  // more than the vehicle may
    wanted_ = {most * trial_.max_speed_mps * (1.5 * uniform_01(random_) - 0.5),
               most * trial_.max_yaw_rate_radps * (2.0 * uniform_01(random_) - 1.0)};
    if (uniform_01(random_) < 0.2) wanted_.omega_radps = 0.0;
    if (uniform_01(random_) < 0.5) wanted_.v_mps = most * trial_.max_speed_mps;
  }
  const bool armed = heard_.state == drivetrain_state_t::ARMED;
  const bool soon = trial_.eager && heard_.state == drivetrain_state_t::ARMING;
  said_ = armed || soon || trial_.stubborn ? wanted_ : Twist{};
}

void Controller::step() {
  if (silent) return;
  choose_twist(loop_.now());
  if (trial_.plans) {
    send_plan({});
  } else {
    send_twist({});
  }
}

void Controller::forge(const Forgery& forgery) {
  if (trial_.plans && uniform_01(random_) < 0.7) {
    send_plan(forgery);
  } else {
    send_twist(forgery);
  }
}

std::int64_t Controller::pose_utime(Instant now) const {
  const Instant newest = now - from_seconds(trial_.pose_age_s);
  return to_utime(frozen ? std::min(*frozen, newest) : newest);
}

void Controller::send_twist(const Forgery& forgery) {
  twist_t m{};
  m.utime = to_utime(loop_.now());
  m.seq = seq_++;
  m.pose_utime = trial_.any ? -1 : pose_utime(loop_.now());
  m.v_mps = said_.v_mps;
  m.omega_radps = said_.omega_radps;
  if (forgery.nan) m.v_mps = std::numeric_limits<double>::quiet_NaN();
  if (forgery.huge) m.v_mps = std::pow(10.0, 300.0 * uniform_01(random_));
  if (forgery.future) m.utime += static_cast<std::int64_t>(2e6 * uniform_01(random_));
  if (forgery.number) m.seq += static_cast<std::int64_t>(1e15 * uniform_01(random_));
  network_.send("AGV/CMD_VEL", encoded(m));
}

void Controller::send_plan(const Forgery& forgery) {
  plan_t m{};
  m.utime = m.start_utime = to_utime(loop_.now());
  m.seq = m.id = seq_++;
  m.session = session_;
  m.based_on = trial_.any                        ? plan_t::ANY
               : heard_.plan.session == session_ ? heard_.plan.id
                                                 : plan_t::NONE;
  m.based_on_last = m.based_on;
  m.pose_utime = pose_utime(loop_.now());
  m.step_us = 100'000;
  m.count = 1 + static_cast<std::int32_t>(trial_.horizon_s / 0.1);
  m.settled_utime = m.start_utime + std::int64_t{m.step_us} * m.count;
  if (forgery.session) m.session += 1000;
  if (forgery.future) m.utime += static_cast<std::int64_t>(2e6 * uniform_01(random_));
  if (forgery.future) m.start_utime += static_cast<std::int64_t>(2e6 * uniform_01(random_));
  if (forgery.number) m.seq += static_cast<std::int64_t>(1e15 * uniform_01(random_));
  const float huge = static_cast<float>(std::pow(10.0, 38.0 * uniform_01(random_)));
  for (std::int32_t k = 0; k < m.count; ++k) {
    m.v_mps.push_back(forgery.huge ? huge : static_cast<float>(said_.v_mps));
    m.omega_radps.push_back(static_cast<float>(said_.omega_radps));
  }
  if (forgery.nan) m.v_mps.back() = std::numeric_limits<float>::quiet_NaN();
  network_.send("AGV/PLAN", encoded(m));
}

// ------------------------------------------------------------------------------------ operator

Operator::Operator(const Trial& trial, EventLoop& loop, Bus& bus, const Heard& heard)
    : trial_(trial),
      loop_(loop),
      bus_(bus),
      heard_(heard),
      random_(random_stream(trial.seed, "operator")) {}

void Operator::step() {
  const Duration looks = from_seconds(trial_.patience_s / 2.0);
  if (loop_.now() < std::max(next_, heard_.since + looks)) return;
  const std::int32_t state = heard_.state;
  if (state == drivetrain_state_t::DISARMED) {
    request(drive_request_t::ARM);
  } else if (state == drivetrain_state_t::ESTOP && !released_) {
    request(drive_request_t::ESTOP_RELEASE);
  } else if (state == drivetrain_state_t::FAULT || state == drivetrain_state_t::UNCONFIRMED ||
             state == drivetrain_state_t::REFUSED || state == drivetrain_state_t::ESTOP) {
    request(drive_request_t::RESET);
  } else {
    return;
  }
  released_ = state == drivetrain_state_t::ESTOP && !released_;
  next_ = loop_.now() + from_seconds(trial_.patience_s * (0.5 + uniform_01(random_)));
}

void Operator::request(std::int32_t kind, Duration late) {
  drive_request_t m{};
  m.utime = to_utime(loop_.now());
  m.seq = seq_++;
  m.request = kind;
  sent_.push_back(encoded(m));
  send(sent_.back(), late);
}

void Operator::replay(double share) {
  if (!sent_.empty()) send(sent_[pick(share, sent_.size())], {});
}

void Operator::send(const std::vector<std::uint8_t>& bytes, Duration late) {
  loop_.at(loop_.now() + late + from_seconds(0.02 * uniform_01(random_)), Priority::delivery,
           [this, bytes](Instant) { bus_.publish("CAN/REQUEST", bytes); });
}

}  // namespace tether::campaign
