#include "onboard/autonomy/supervisor.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace tether {

Twist slowed_to(const Twist& twist, const Outline& outline, double allowed_mps) {
  const double pace = pace_mps(twist, outline);
  if (pace <= allowed_mps) return twist;
  const double share = allowed_mps / pace;
  return {share * twist.v_mps, share * twist.omega_radps};
}

Twist Setpoint::step(const Twist& target, double allowed_mps, double dt_s) {
  const double pace = pace_mps(twist_, outline_);
  const bool to_rest = target.v_mps == 0.0 && target.omega_radps == 0.0;
  if (pace > allowed_mps) {
    twist_ = braked(dt_s, to_rest ? 0.0 : allowed_mps / pace);
  } else if (to_rest) {
    twist_ = braked(dt_s, 0.0);
  } else {
    twist_ = nearer(slowed_to(target, outline_, allowed_mps), allowed_mps, dt_s);
  }
  return twist_;
}

Twist Setpoint::braked(double dt_s, double least_share) const {
  const double time_s = std::max(std::abs(twist_.v_mps) / limits_.acceleration_mps2,
                                 std::abs(twist_.omega_radps) / limits_.yaw_acceleration_radps2);
  if (time_s <= dt_s && least_share == 0.0) return {};
  const double share = std::max(1.0 - dt_s / time_s, least_share);
  return {share * twist_.v_mps, share * twist_.omega_radps};
}

Twist Setpoint::nearer(const Twist& target, double allowed_mps, double dt_s) const {
  const double most_mps = limits_.acceleration_mps2 * dt_s;
  const double most_radps = limits_.yaw_acceleration_radps2 * dt_s;
  const double dv = std::clamp(target.v_mps - twist_.v_mps, -most_mps, most_mps);
  const double dw = std::clamp(target.omega_radps - twist_.omega_radps, -most_radps, most_radps);
  // Both changes by one factor where the sum would be too fast: each of the old and the target
  // alone is not, but on the way from one to the other one axis may have to wait.
  double share = 1.0;
  const auto keep_below = [&share](double from, double change, double most) {
    const double to = from + change;
    if (std::abs(to) > most && change != 0.0) {
      share = std::min(share, std::max((std::copysign(most, to) - from) / change, 0.0));
    }
  };
  keep_below(twist_.v_mps, dv, allowed_mps);
  keep_below(twist_.omega_radps, dw, allowed_mps / outline_.reach_m());
  return {twist_.v_mps + share * dv, twist_.omega_radps + share * dw};
}

const char* to_string(DriveState state) {
  switch (state) {
    case DriveState::autonomous:
      return "autonomous";
    case DriveState::protective_stop:
      return "protective stop";
    case DriveState::remote_requested:
      return "remote requested";
    case DriveState::remote:
      return "remote";
    case DriveState::returning:
      return "returning";
  }
  return "";
}

Supervisor::Supervisor(const AutonomySettings& settings, Instant earliest)
    : wait_(from_seconds(settings.wait_s)),
      clear_for_(from_seconds(settings.clear_for_s)),
      remote_timeout_(from_seconds(settings.remote_timeout_s)),
      remote_max_age_(from_seconds(settings.remote_max_age_s)),
      guard_({.earliest = earliest}) {}

void Supervisor::enter(Instant now, DriveState state, const std::string& reason) {
  state_ = state;
  reason_ = reason;
  since_ = now;
}

void Supervisor::ask(Instant now, const std::string& reason) {
  enter(now, DriveState::remote_requested, reason);
  asked_ = now;
  ++handover_;
  ++requests_;
}

std::string Supervisor::trouble(const Sight& sight) const {
  if (!sight.unfit.empty()) return sight.unfit;
  if (!sight.localised) return "localisation is lost";
  return sight.blocked ? "something is in the stopping field" : "";
}

void Supervisor::step(Instant now, const Sight& sight) {
  const std::string trouble = this->trouble(sight);
  const bool good = trouble.empty() && sight.way_free && sight.on_path;
  if (good && !good_) good_since_ = now;
  good_ = good;
  stood_ = sight.stands;
  several_ = sight.several_senders;
  const bool goes_on = good && now - good_since_ >= clear_for_;
  const bool waited = now - since_ >= wait_;
  switch (state_) {
    case DriveState::autonomous:
      if (!trouble.empty()) enter(now, DriveState::protective_stop, trouble);
      break;
    case DriveState::protective_stop:
      if (!trouble.empty()) reason_ = trouble;
      if (!sight.stands) break;
      if (goes_on) {
        enter(now, DriveState::autonomous, "");
      } else if (waited) {
        ask(now, trouble.empty() ? "the way along the path is not free" : trouble);
      }
      break;
    case DriveState::remote_requested:
      if (!goes_on) break;
      ++handover_;
      enter(now, DriveState::autonomous, "");
      break;
    case DriveState::remote:
      if (goes_on) {
        ++handover_;
        enter(now, DriveState::returning, "on the path, and the way is free");
      } else if (now - heard_ >= remote_timeout_ + wait_ && sight.stands) {
        ++silences_;
        ask(now, "the remote driver is silent");
      }
      break;
    case DriveState::returning:
      if (!sight.stands) break;
      if (goes_on) {
        enter(now, DriveState::autonomous, "");
      } else {
        enter(now, DriveState::protective_stop,
              trouble.empty() ? "the way along the path is not free" : trouble);
      }
      break;
  }
}

RemoteFate Supervisor::hear(Instant now, Instant stamp, std::int64_t seq, bool is_stop,
                            std::optional<Instant> report, const std::function<bool()>& follow) {
  RemoteFate fate = judge(now, stamp, seq, is_stop, report);
  if (fate == RemoteFate::accepted && !follow()) fate = RemoteFate::not_followed;
  ++fates_.at(static_cast<std::size_t>(fate));
  if (fate != RemoteFate::accepted) return fate;
  heard_ = now;
  if (state_ == DriveState::remote_requested) {
    enter(now, DriveState::remote, "driven remotely: " + reason_);
  }
  return fate;
}

RemoteFate Supervisor::judge(Instant now, Instant stamp, std::int64_t seq, bool is_stop,
                             std::optional<Instant> report) {
  if (state_ != DriveState::remote_requested && state_ != DriveState::remote) {
    return RemoteFate::unasked;
  }
  if (several_) return RemoteFate::several;
  // Stamps have whole microseconds, rounded down.
  if (!report || to_utime(*report) < to_utime(asked_)) return RemoteFate::other_handover;
  if (*report > now) return RemoteFate::from_future;
  if (now - *report > remote_max_age_) return RemoteFate::old;
  if (!guard_.accept(now, stamp, seq)) return RemoteFate::out_of_order;
  if (state_ == DriveState::remote_requested && !(is_stop && stood_)) {
    return RemoteFate::not_from_rest;
  }
  return RemoteFate::accepted;
}

Driver Supervisor::driver(Instant now) const {
  if (state_ == DriveState::autonomous) return Driver::law;
  const bool remote = state_ == DriveState::remote && !several_ && remote_is_fresh(now);
  return remote ? Driver::remote : Driver::none;
}

void Supervisor::list(CounterList& out) const {
  constexpr std::array<const char*, kRemoteFates> kNames{
      "accepted", "unasked",      "several",       "other_handover", "from_future",
      "old",      "out_of_order", "not_from_rest", "not_followed"};
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    out.emplace_back(std::string("remote.") + kNames.at(i), fates_.at(i));
  }
  out.emplace_back("remote.requests", requests_);
  out.emplace_back("remote.silences", silences_);
}

}  // namespace tether
