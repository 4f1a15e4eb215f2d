#pragma once

#include <optional>
#include <string>
#include <tether/drivetrain_state_t.hpp>
#include <tether/odometry_t.hpp>

#include "common/base/time.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {

/// Command of `tether can drive`: zero until the drivetrain is armed, then one twist for a
/// time, then zero until the vehicle stands.
///
/// It gives up, and commands zero for kLastZeros, when
/// - the drivetrain is not armed within kArmPatience, or leaves ARMED later;
/// - CAN/STATE is silent for kSilence;
/// - the bridge's setpoint comes to rest at another twist: the wanted one is beyond its limits;
/// - another program sends commands, too, or interrupt() is called.
class TwistDrive {
 public:
  static constexpr Duration kPeriod = std::chrono::milliseconds{50};  ///< period of step()
  static constexpr Duration kFirstZeros = std::chrono::milliseconds{300};
  static constexpr Duration kArmPatience = std::chrono::minutes{5};
  static constexpr Duration kSilence = std::chrono::milliseconds{500};
  /// A setpoint that has not changed for this long has come to rest.
  static constexpr Duration kSettled = std::chrono::milliseconds{500};
  static constexpr Duration kStopPatience = std::chrono::seconds{10};
  static constexpr Duration kLastZeros = std::chrono::milliseconds{500};

  enum class Phase { waiting, driving, stopping, done };

  TwistDrive(const Twist& twist, Duration duration, Instant now);

  void on_state(const drivetrain_state_t& state, Instant now);
  void on_odometry(const odometry_t& odometry);
  void on_foreign_command(Instant now);
  void interrupt(Instant now);

  /// Present command.
  Twist step(Instant now);

  Phase phase() const { return phase_; }
  /// Why it gave up; empty if it did not.
  const std::string& failure() const { return failure_; }
  /// By CAN/ODOMETRY since the twist was first commanded; yaw counts on beyond a whole turn.
  double distance_m() const { return distance_m_; }
  double yaw_rad() const { return yaw_rad_; }

 private:
  void wait(Instant now);
  void drive(Instant now);
  void come_to_rest(Instant now);
  void enter(Phase phase, Instant now);
  void give_up(const std::string& why, Instant now);
  bool armed() const { return state_ && state_->state == drivetrain_state_t::ARMED; }
  bool stands() const;
  bool beyond_limits(Instant now) const;

  Twist twist_;
  Duration duration_;
  Phase phase_ = Phase::waiting;
  Instant since_;    // beginning of the phase
  Instant heard_;    // newest state
  Instant changed_;  // newest change of the setpoint
  std::optional<drivetrain_state_t> state_;
  std::optional<odometry_t> odometry_;
  double distance_m_ = 0.0;
  double yaw_rad_ = 0.0;
  std::string failure_;
};

/// "fault: right drive (node 2): …"
std::string state_line(const drivetrain_state_t& state);

}  // namespace tether
