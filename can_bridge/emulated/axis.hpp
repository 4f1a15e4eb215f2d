#pragma once

#include <cstdint>

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/emulated/encoder.hpp"
#include "can_bridge/emulated/objects.hpp"
#include "common/base/time.hpp"

namespace tether {

/// One axis of an emulated drive: the power drive system's state machine and the ramps of profile
/// velocity mode (CiA 402 = IEC 61800-7-201, -301). Units of speed are those of the target velocity
/// object; of acceleration, the same per second.
///
/// Controlword commands act at tick(), at most one transition a tick, and as levels: a held "enable
/// operation" takes ReadyToSwitchOn over SwitchedOn to OperationEnabled. Two need a fresh write:
/// fault reset (rising edge of bit 7), and leaving QuickStopActive for OperationEnabled. Only
/// "shutdown" leads out of SwitchOnDisabled, so that nothing moves again by itself.
///
/// Power stage off: a spring-applied brake holds the wheel, and the setpoint is zero; without brake
/// it coasts, and the setpoint is the speed that friction leaves it.
class EmulatedAxis {
 public:
  explicit EmulatedAxis(bool brake = true) : brake_(brake) {}

  static constexpr int kProfileVelocity = 3;  ///< the one mode of operation (0x6060) there is
  /// From power-on to SwitchOnDisabled: the drive's self test.
  static constexpr Duration kSelfTest = std::chrono::milliseconds{20};

  /// Objects of the axis, as they are at a tick.
  struct Settings {
    int mode = 0;                          ///< 0x6060
    double target = 0.0;                   ///< 0x60FF
    double acceleration = 1.0;             ///< 0x6083
    double deceleration = 1.0;             ///< 0x6084
    double quick_stop_deceleration = 1.0;  ///< 0x6085
    double max_speed = 1.0;                ///< 0x607F
    double window = 1.0;  ///< within this of the target, or of zero, the wheel "is there"
    /// 0x605A: 0 power off at once; 1, 2 ramp 6084, 6085, then SwitchOnDisabled; 5, 6 the same, but
    /// stay in QuickStopActive.
    int quick_stop_option = 2;
    int fault_reaction_option = 2;  ///< 0x605E: 0 power off at once; 1, 2 ramp 6084, 6085
    double actual = 0.0;            ///< measured speed
    double friction = 1.0;          ///< slows down a wheel that coasts
    double push = 0.0;              ///< accelerates one; signed
    double brake_share = 1.0;       ///< acting share of the decelerations
  };

  /// Power-on or reset: NotReadyToSwitchOn, everything forgotten.
  void power_up();

  /// A write of the controlword, by SDO or PDO.
  void write_control(std::uint16_t word);

  void tick(const Settings& settings, Duration dt);
  /// While the drive's firmware does not run: the wheel goes on by itself.
  void coast(double friction, double push, Duration dt);

  /// A fault: fault reaction, then Fault. The first of several keeps its error code.
  void trip(std::uint16_t error_code);
  /// The same as the controlword's commands, but as the drive's own reaction to a lost connection.
  void quick_stop();
  void disable_voltage();
  /// Statusword bit 7.
  void set_warning(bool warning) { warning_ = warning; }

  canopen::DriveState state() const { return state_; }
  std::uint16_t statusword() const;
  /// Ramped setpoint of the speed servo, or the speed of a wheel that coasts.
  double setpoint() const { return setpoint_; }
  std::uint16_t error_code() const { return error_code_; }  ///< 0x603F: of the fault; 0 none
  bool powered() const {
    return state_ == canopen::DriveState::operation_enabled ||
           state_ == canopen::DriveState::quick_stop_active ||
           (state_ == canopen::DriveState::fault_reaction && braking_);
  }

 private:
  using State = canopen::DriveState;

  bool commands_shutdown() const { return (control_ & 0x87) == 0x06; }
  bool commands_switch_on() const { return (control_ & 0x87) == 0x07; }
  bool commands_enable() const { return (control_ & 0x8F) == 0x0F; }
  bool commands_disable_voltage() const { return (control_ & 0x82) == 0x00; }
  bool commands_quick_stop() const { return (control_ & 0x86) == 0x02; }
  bool halted() const { return (control_ & canopen::kControlHalt) != 0; }

  void enter(State state);
  void follow_control(const Settings& s);
  void follow_control_enabled(const Settings& s);
  void finish_quick_stop(const Settings& s);
  void finish_fault_reaction(const Settings& s);
  void move(const Settings& s, double dt_s);
  void ramp_to(double target, double acceleration, double deceleration, double dt_s);
  void judge(const Settings& s);

  bool brake_;
  State state_ = State::not_ready;
  Duration self_test_left_ = kSelfTest;
  std::uint16_t control_ = 0;
  std::uint16_t error_code_ = 0;
  bool reset_edge_ = false;
  bool written_ = false;  // the controlword, since the state was entered
  bool braking_ = false;  // fault reaction with the power stage on
  bool warning_ = false;
  double setpoint_ = 0.0;
  // Statusword bits that depend on the motion
  bool target_reached_ = false;
  bool internal_limit_ = false;
  bool speed_zero_ = true;
};

/// An axis of an emulated drive with its encoder, as its objects set and show it.
struct EmulatedDriveAxis {
  AxisObjects objects;
  EmulatedAxis machine;
  EmulatedEncoder encoder;
  double coasting_radps2 = 1.0;  ///< deceleration of a wheel without power and brake
  double push_radps2 = 0.0;      ///< a load that accelerates it, forward positive
  double brake_share = 1.0;      ///< acting share of the drive's ramps towards zero

  /// Runs the axis for `dt` with what the objects say.
  void run(const ObjectDictionary& dictionary, Duration dt);

  /// Lets `dt` pass while the drive's firmware does not run.
  void coast(Duration dt);

  /// Updates statusword, error code, mode display, speed and position. `device_error` shows where
  /// the axis has no error of its own.
  void show(ObjectDictionary& dictionary, std::uint16_t device_error) const;

  /// The setpoint as the wheel's angular speed, forward positive.
  double wheel_target_radps() const {
    return machine.setpoint() / objects.target_per_radps * objects.sign;
  }

 private:
  double actual(double units_per_radps) const {
    return encoder.speed_radps() * units_per_radps * objects.sign;
  }
};

}  // namespace tether
