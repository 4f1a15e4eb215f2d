#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "common/base/counters.hpp"
#include "common/base/time.hpp"
#include "common/node/stream_guard.hpp"
#include "common/vehicle/pose.hpp"
#include "common/world/onboard_settings.hpp"
#include "onboard/autonomy/swept_way.hpp"

namespace tether {

/// The setpoint that the drives get: it never jumps, also when the driver changes. Pure.
///
/// From one step to the next v changes by at most a·dt and ω by at most α·dt. Where it has to
/// become slower than it is, v and ω shrink by one factor, so that the vehicle stays on the arc
/// that its stopping field was swept along; |v| then falls at a, or slower where ω takes longer.
class Setpoint {
 public:
  struct Limits {
    double acceleration_mps2 = 1.0;        ///< a > 0
    double yaw_acceleration_radps2 = 2.0;  ///< α > 0; at least a/reach, or the field is too short
  };

  Setpoint(const Limits& limits, const Outline& outline) : limits_(limits), outline_(outline) {}

  /// One step of `dt_s` towards `target` (finite), with a pace (pace_mps) of at most `allowed_mps`
  /// ≥ 0 as soon as the limits let it.
  Twist step(const Twist& target, double allowed_mps, double dt_s);

  const Twist& twist() const { return twist_; }
  bool stands() const { return twist_.v_mps == 0.0 && twist_.omega_radps == 0.0; }

 private:
  Twist braked(double dt_s, double least_share) const;
  Twist nearer(const Twist& target, double allowed_mps, double dt_s) const;

  Limits limits_;
  Outline outline_;
  Twist twist_;
};

/// `twist` on its curve, with a pace of at most `allowed_mps`.
Twist slowed_to(const Twist& twist, const Outline& outline, double allowed_mps);

/// The states of autonomy_state_t, same numbers.
enum class DriveState : std::int32_t {
  autonomous,
  protective_stop,
  remote_requested,
  remote,
  returning,
};
/// "autonomous", "protective stop" …
const char* to_string(DriveState state);

/// Whose twist the vehicle takes; there is one at a time, or none.
enum class Driver { none, law, remote };

/// Result of a remote driver's command.
enum class RemoteFate {
  accepted,
  unasked,         ///< the vehicle did not ask for a remote driver
  several,         ///< several programs send commands
  other_handover,  ///< names no report of the present handover
  from_future,     ///< names a report that the vehicle has not made yet
  old,             ///< the report that its sender saw is too old
  out_of_order,    ///< refused by StreamGuard
  not_from_rest,   ///< the first command of a driver has to be a stop
  not_followed,    ///< a plan that the actuator refuses: plan.… says why
};
inline constexpr std::size_t kRemoteFates = 9;

/// Who drives, and when that changes. Pure: time and what the vehicle sees and hears are arguments.
///
/// A remote driver's command counts if all of this holds, else it is counted as refused:
/// - the vehicle asks (REMOTE_REQUESTED) or is driven remotely (REMOTE);
/// - it *names the handover*: its pose_utime is that of a report (autonomy_state_t), in which the
///   vehicle said REMOTE_REQUESTED or REMOTE, of the present request. Both times are the vehicle's
///   own: the command's sender had received this request, whatever was lost, sent
///   twice, delayed or reordered on the way, and whatever clock its sender has;
/// - the report that it names is not older than remote_max_age_s: the driver knows the present;
/// - it is newer than all before (StreamGuard), and one program alone sends;
/// - the first is a stop: a driver begins from standstill;
/// - the vehicle will do what it says: a plan that is over or makes no sense is not a word.
///
/// Between two drivers the vehicle stands. A driver who says nothing for remote_timeout_s is no
/// driver: the vehicle comes to rest; after wait_s of that it asks again, and commands that name
/// the request before no longer count.
class Supervisor {
 public:
  /// The vehicle's knowledge at a step.
  struct Sight {
    bool localised = false;
    std::string unfit;     ///< why it must not drive: it does not see, wheels do not follow; "" …
    bool blocked = false;  ///< it cannot go on, or has to stop now
    bool way_free = false;  ///< along the path from where it is, by its scanner
    bool on_path = false;   ///< near enough, and in the path's direction
    bool stands = false;
    bool several_senders = false;
  };

  explicit Supervisor(const AutonomySettings& settings, Instant earliest = kStart);

  /// At each setpoint; `now` does not go backwards.
  void step(Instant now, const Sight& sight);

  /// A command or plan that arrives at `now`, with what its sender wrote on it. `is_stop`: it says
  /// to stand still. `report`: its pose_utime, none for −1. `follow` is called if nothing else
  /// speaks against it, and says whether the vehicle follows it from now on.
  RemoteFate hear(Instant now, Instant stamp, std::int64_t seq, bool is_stop,
                  std::optional<Instant> report, const std::function<bool()>& follow);

  DriveState state() const { return state_; }
  const std::string& reason() const { return reason_; }
  /// Counts up with each request for a remote driver and each end of one.
  std::int64_t handover() const { return handover_; }
  /// None while the vehicle has to come to rest, or stays so.
  Driver driver(Instant now) const;
  /// When the law on board may go on: since when it has known that it can.
  std::int64_t requests() const { return requests_; }

  /// Appends "remote.accepted", one for each reason of refusal, "remote.requests" and
  /// "remote.silences".
  void list(CounterList& out) const;

 private:
  void enter(Instant now, DriveState state, const std::string& reason);
  void ask(Instant now, const std::string& reason);
  std::string trouble(const Sight& sight) const;
  RemoteFate judge(Instant now, Instant stamp, std::int64_t seq, bool is_stop,
                   std::optional<Instant> report);
  bool remote_is_fresh(Instant now) const { return now - heard_ < remote_timeout_; }

  Duration wait_, clear_for_, remote_timeout_, remote_max_age_;
  DriveState state_ = DriveState::autonomous;
  std::string reason_;
  Instant since_{};
  Instant good_since_{};  ///< nothing has spoken against driving on since then
  bool good_ = false;
  Instant asked_{};       ///< the present request
  Instant heard_{};       ///< the last command that counted
  bool stood_ = true;     ///< at the last step
  bool several_ = false;  ///< at the last step
  std::int64_t handover_ = 0;
  std::int64_t requests_ = 0;
  std::int64_t silences_ = 0;
  StreamGuard guard_;
  std::array<std::int64_t, kRemoteFates> fates_{};
};

}  // namespace tether
