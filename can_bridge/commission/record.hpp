#pragma once

#include <string>
#include <vector>

#include "can_bridge/cia402/config.hpp"

namespace tether {

/// Results of `tether can commission` for the drives of one vehicle, for the bridge to
/// compare before it arms real drives (CommissionGuard), and for people to read.
struct CommissionRecord {
  /// A named fact: {"left.sign", "1"}.
  struct Item {
    std::string name;
    std::string value;

    bool operator==(const Item&) const = default;
  };
  /// Result of one trial with one drive.
  struct Result {
    std::string drive;    ///< "left drive (node 1)"
    std::string trial;    ///< trial_name()
    std::string found;    ///< "stands after 0.31 s and 0.020 m"
    std::string problem;  ///< fault and remedy; "" if the result is as required
  };

  static constexpr double kSlowest_mps = 0.01;

  std::string vehicle;
  std::string interface;
  std::string operator_name;
  std::string date;             ///< UTC, ISO 8601
  std::string wheels;           ///< "free" or "on the floor"
  double speed_mps = 0.0;       ///< speed of the trials, from kSlowest_mps on
  std::vector<Item> settings;   ///< commissioned_settings()
  std::vector<Item> objects;    ///< ObjectReader::values()
  std::vector<Result> results;  ///< in the order of the trials

  /// Whether there are results and none of them is a problem.
  bool passed() const;
};

std::string to_toml(const CommissionRecord& record);

/// Throws UsageError that names `file`, line and key for anything that is not a whole record.
CommissionRecord parse_record(const std::string& toml, const std::string& file);

/// Parts of the drivetrain's file and of the vehicle that determine the commands to the drives.
std::vector<CommissionRecord::Item> commissioned_settings(const Cia402Config& config,
                                                          double wheel_radius_m);

/// How `now` differs from what was `recorded`: "left.sign is -1, was 1; …"; "" if it does not.
std::string differences(const std::vector<CommissionRecord::Item>& recorded,
                        const std::vector<CommissionRecord::Item>& now);

}  // namespace tether
