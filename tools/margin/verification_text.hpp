#pragma once

#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "tools/experiment/design/experiment.hpp"
#include "tools/margin/verification.hpp"

namespace tether {

/// A table of an experiment's critical values: the grid's settings; predicted and simulated values,
/// their 95 % intervals, by how much they are off; and why there is none.
class VerificationTable {
 public:
  explicit VerificationTable(const Experiment& experiment);

  std::string head() const;
  std::string row(const Arm& arm, const VerifiedCritical& row) const;

 private:
  std::string line(const std::vector<std::string>& settings,
                   const std::vector<std::string>& cells) const;

  std::vector<std::string> keys_;
  std::vector<std::size_t> widths_;  ///< widths of the settings' columns
};

nlohmann::ordered_json verification_json(const Arm& arm, const VerifiedCritical& row);

}  // namespace tether
