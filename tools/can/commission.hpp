#pragma once

#include <string>
#include <vector>

namespace tether {

struct CanCommissionOptions {
  std::string scenario_file;
  std::vector<std::string> overrides;  ///< --set
  std::string operator_name;
  bool wheels_free = false;
  bool on_floor = false;
  double speed_mps = 0.0;   ///< 0: as fast as is allowed
  std::string record_file;  ///< "": can.commission_record, else the one in the state folder
};

/// Runs a Commission on the scenario's interface and drivetrain, prints what it finds, and writes
/// the record. Exit code 0: all is as it must be. A signal stops the drives first. Throws
/// UsageError for what cannot be commissioned.
int can_commission(const CanCommissionOptions& options);

}  // namespace tether
