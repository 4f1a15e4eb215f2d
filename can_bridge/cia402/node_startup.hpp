#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "can_bridge/bus/sdo_client.hpp"
#include "can_bridge/cia402/startup.hpp"

namespace tether::cia402 {

/// Brings one node from any state to "configured, pre-operational": NMT reset, boot-up message, SDO
/// steps one by one, each confirmed. Ends done() or with a refusal().
///
/// A node without boot-up message within boot_timeout_ms is reset once more, and then has twice as
/// long: a slow one may restart with each reset. The same time passes from its boot-up message
/// to its first SDO answer, at most. One that reboots during its configuration starts it again, up
/// to 3 times in all.
class NodeStartup {
 public:
  NodeStartup(const Cia402Config& config, std::uint8_t node);

  /// From the beginning, at the next tick.
  void begin();

  void on_boot_up();
  /// A frame with the identifier 0x580 + node. False: not the reply that is waited for.
  bool on_sdo(const CanFrame& frame) { return sdo_.on_frame(frame); }
  /// `may_reset_again`: its wheel is known to stand, so that a reset that had no answer may be
  /// repeated.
  void tick(Instant now, std::vector<CanFrame>& out, bool may_reset_again = true);
  bool has_reset() const { return resets_ > 0; }
  bool wants_reset_again() const { return state_ == State::reset && resets_ > 0; }

  bool done() const { return state_ == State::done; }
  /// Why the node cannot be used, and what to do about it; "" if nothing is known against it.
  const std::string& refusal() const { return refusal_; }
  /// Next event that it waits for: "left drive (node 1): step 3 of 40: 0x1017:0 (heartbeat
  /// producer)".
  std::string progress() const;
  /// Whether the drive did not show its mode of operation yet: it has to when it is enabled.
  bool shows_mode_late() const { return shows_mode_late_; }
  /// The optional objects that the drive does not have, or that it refused.
  const std::vector<std::string>& notes() const { return notes_; }
  /// The steps whose objects read as they should at the end of this start-up.
  const std::vector<SdoStep>& confirmed() const { return confirmed_; }

 private:
  enum class State { idle, reset, booting, configuring, done, refused };

  void refuse(const std::string& why);
  void begin_steps();
  void begin_step();
  Duration boot_time() const { return boot_timeout_ * resets_; }
  void next_step();
  void on_result(const SdoResult& result, Instant now);
  void on_value(const SdoStep& step, std::int64_t value, Instant now);
  void on_failure(const SdoStep& step, const std::string& what, const std::string& advice);
  void finish();

  std::string name_;
  std::uint8_t node_;
  Duration boot_timeout_;
  Duration step_timeout_;
  Duration sdo_timeout_;
  int sdo_tries_;
  std::vector<SdoStep> steps_;

  SdoClient sdo_;
  State state_ = State::idle;
  Instant deadline_{};                    // deadline of the boot-up message
  std::optional<Instant> answers_until_;  // deadline of the first SDO answer
  int resets_ = 0;
  int boots_ = 0;
  std::size_t step_ = 0;
  bool reading_ = false;                  // the step's write, if any, is confirmed
  std::optional<Instant> reading_until_;  // deadline of `eventually_equal`
  SdoStep kept_;                          // the newest Check::keep, and in `expected` what it read
  bool shows_mode_late_ = false;
  int watchdogs_set_ = 0;
  std::string watchdog_failures_;
  std::string refusal_;
  std::vector<std::string> notes_;
  std::vector<SdoStep> confirmed_;
};

}  // namespace tether::cia402
