#pragma once

#include <optional>
#include <string>
#include <vector>

#include "can_bridge/commission/readings.hpp"
#include "can_bridge/commission/record.hpp"
#include "can_bridge/drivetrain/drive_profile.hpp"

namespace tether {

/// Lets the bridge arm only the drives that were commissioned, as they were: compares the record
/// with the drivetrain's file at once, and with the drives' objects after each start-up, in
/// standby, where the profile itself uses no SDO. Pure: frames and time in, frames out.
class CommissionGuard {
 public:
  /// `record`: nullopt if there is none; `why`: then, what is wrong with it.
  CommissionGuard(const Cia402Config& config, double wheel_radius_m,
                  std::optional<CommissionRecord> record, const std::string& why);

  void on_frame(const CanFrame& frame);
  /// Each cycle; appends upload requests.
  void tick(Instant now, DrivePhase phase, std::vector<CanFrame>& out);

  /// Why nothing may be armed; "" if it may.
  const std::string& refusal() const { return refusal_; }

 private:
  void compare(const ObjectReader& reader);

  std::vector<RecordedObject> objects_;
  CommissionRecord record_;
  std::string refusal_;
  bool final_ = false;  ///< the refusal does not depend on the drives
  bool compared_ = false;
  std::optional<ObjectReader> reader_;
};

}  // namespace tether
