#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "can_bridge/bus/can_frame.hpp"
#include "can_bridge/drivetrain/safety_input.hpp"
#include "common/base/counters.hpp"
#include "common/base/time.hpp"

namespace tether {

/// Present demands of the vehicle's safety inputs, all together.
struct SafetyDemands {
  std::string stop;         ///< why the vehicle has to stand; "" if it need not
  bool ramp = false;        ///< stop: by the ramp, not by a quick stop
  bool may_resume = false;  ///< stop: it stays armed and goes on when nothing demands it any more
  std::string estop;        ///< why the vehicle is emergency-stopped; "" if it is not
  /// For the faster rim; and who wants it.
  std::optional<double> speed_limit_mps{};
  std::string speed_limit_by;
  /// Why the e-stop must not be released and nothing be armed: it would not outlive the bridge; ""
  /// if it would. A vehicle that is armed goes on, for the e-stop acts.
  std::string no_release;
  /// Why nothing may be armed; "" if it may. A vehicle that is armed goes on.
  std::string no_arming;
};

/// The vehicle's safety inputs (SafetyInputConfig): what they say, and what that demands. Pure:
/// frames, levels and time in, demands out.
///
/// - protective_stop: quick stop or ramp, then disarmed; it never starts again by itself. With
///   restart_after_s it ramps to standstill, stays armed, and goes on when all such inputs have
///   been clear for that long. ISO 3691-4 (2020, 4.1.14) forbids automatic restart after e-stop and
///   bumper, not after a personnel detection field.
/// - speed_limit: the limit, while it is demanded.
/// - estop_status: emergency stop.
/// - An input that is silent (a CAN frame for timeout_ms, a line that cannot be read), or that
///   makes no sense (wrong length, bits that contradict), demands a quick stop and disarms, also a
///   speed_limit or one with restart_after_s; an estop_status is then an emergency stop. One that
///   was never heard demands a stop, whatever its function: a start of the bridge latches nothing.
/// - An open wire looks like a demand.
///
/// A demand between two cycles, however short, counts in the next one.
///
/// This is software, no safety function: the scanner has to stop the drives by hardware (STO), too.
class SafetyInputs {
 public:
  explicit SafetyInputs(std::vector<SafetyInputConfig> inputs);

  bool empty() const { return inputs_.empty(); }
  /// The frames that on_frame() wants to see.
  std::vector<CanFilter> filters() const;
  /// Whether the frame was one of the inputs'.
  bool on_frame(const CanFrame& frame, Instant now);
  /// The line of input `i`; nullopt if it cannot be read.
  void on_level(std::size_t i, std::optional<bool> clear);

  /// Once per control cycle, before it is decided.
  SafetyDemands cycle(Instant now);

  /// Appends "input.NAME.demands", "….silences", "….nonsense": how often each of them began.
  void list(CounterList& out) const;

 private:
  enum class Condition { clear, demanding, nonsense, silent };
  struct Input {
    SafetyInputConfig config;
    bool heard = false;                    ///< ever
    Condition level = Condition::silent;   ///< newest
    Condition worst = Condition::clear;    ///< since the last cycle
    Condition before = Condition::silent;  ///< in the last cycle
    std::string nonsense;                  ///< inputs with a malformed message
    std::optional<Instant> stamp{};        ///< CAN: of the newest frame
    Instant clear_since{};
    std::int64_t demands = 0;
    std::int64_t silences = 0;
    std::int64_t nonsenses = 0;
  };

  static void note(Input& input, Condition condition);
  static Condition judge(Input& input, const CanFrame& frame);
  static Condition condition(const Input& input, Instant now);
  static void count(Input& input, Condition condition, Instant now);
  static std::string trouble(const Input& input, Condition condition);
  static void demand(SafetyDemands& all, const Input& input, Condition condition, Instant now);

  std::vector<Input> inputs_;
};

}  // namespace tether
