#pragma once

#include <optional>
#include <string>
#include <utility>

#include "can_bridge/drivetrain/drive_profile.hpp"
#include "common/base/time.hpp"

namespace tether::cia402 {

/// Where the profile is on its way. The order counts: from `settling` on, all drives are
/// configured and operational.
enum class Stage {
  idle,         ///< before start()
  listening,    ///< for drives that are there already
  securing,     ///< until the wheels of those stand
  configuring,  ///< reset, boot-up, SDO
  beating,      ///< the drives get to know the bridge's heartbeat
  activating,   ///< NMT start, until all drives are operational and send feedback
  settling,     ///< until power stages are off and wheels stand
  standby,
  verifying,  ///< reading back what start-up has configured, power stages off
  enabling,
  enabled,
  stopping,
  faulted,
  clearing,  ///< fault reset under way
  refused,
};

/// The stage as reported to the bridge.
DrivePhase phase_of(Stage stage);

/// The present stage, for how long, and why.
class StageClock {
 public:
  Stage stage() const { return stage_; }
  const std::string& reason() const { return reason_; }

  void enter(Stage stage, std::string reason = "") {
    stage_ = stage;
    since_.reset();
    reason_ = std::move(reason);
  }
  /// Changes the reason; the stage stays.
  void tell(std::string reason) { reason_ = std::move(reason); }

  /// Called in every tick: a stage begins with the first tick in it.
  void mark(Instant now) {
    if (!since_) since_ = now;
  }
  /// The second part of a stage begins.
  void restart(Instant now) { since_ = now; }
  /// How long the stage (or its second part) has lasted; zero in its first tick.
  Duration elapsed(Instant now) const { return now - since_.value_or(now); }

 private:
  Stage stage_ = Stage::idle;
  std::optional<Instant> since_;
  std::string reason_;
};

}  // namespace tether::cia402
