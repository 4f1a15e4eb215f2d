#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "can_bridge/bus/can_frame.hpp"
#include "can_bridge/drivetrain/safety_input.hpp"
#include "common/base/time.hpp"

namespace tether {

/// The senders of a vehicle's safety inputs on CAN, as a drivetrain's file describes them: each
/// frame at a third of its shortest timeout_ms, all inputs clear until told otherwise. No I/O and
/// no clock. Inputs on GPIO lines are not emulated.
class EmulatedSafetyInputs {
 public:
  /// Action of an input.
  enum class Act {
    clear = -1,
    demand = 0,
    silence = 1,   ///< its frame is not sent
    nonsense = 2,  ///< its frame is a byte shorter, or longer where it has only one
  };

  explicit EmulatedSafetyInputs(const std::vector<SafetyInputConfig>& inputs);

  /// `number`: from 1 on, in the order of the file; 0: all.
  bool has(std::int64_t number) const;
  void set(std::int64_t number, Act act);
  /// Appends the frames that are due.
  void tick(Instant now, std::vector<CanFrame>& out);

 private:
  struct Sender {  // sender of one frame, for all inputs in it
    std::uint32_t id = 0;
    Duration period{};
    std::optional<Instant> next{};
  };
  CanFrame frame(std::uint32_t id) const;
  bool any(std::uint32_t id, Act act) const;

  std::vector<std::optional<CanInputWiring>> inputs_;  // nullopt: GPIO
  std::vector<Act> acts_;
  std::vector<Sender> senders_;
};

}  // namespace tether
