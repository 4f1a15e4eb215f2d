#pragma once

#include <string>
#include <vector>

namespace tether {

struct CanProbeOptions {
  std::string interface = "can0";
  std::vector<int> nodes;       ///< 1…127; empty: those of the drivetrain file
  std::string drivetrain_file;  ///< empty: the scenario's; without one: only look
  std::string scenario_file;    ///< the vehicle that the file is for; empty: the keys' defaults
  bool scan = false;            ///< ask all node ids who they are, instead of these
};

/// Looks at the drives on a bus and prints what it finds; changes nothing, moves nothing. Exit
/// code 0: all nodes answer and fit the file.
int can_probe(const CanProbeOptions& options);

}  // namespace tether
