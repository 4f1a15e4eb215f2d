#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/scenario/scenario.hpp"
#include "tools/log/scene_setting.hpp"
#include "tools/view/sources/network_parameters.hpp"

namespace tether {

/// Content of /api/run.json about the shown run.
struct RunDescription {
  std::string kind;    ///< "live", "log" or "run"
  std::string source;  ///< the LCM URL, the log's or the scenario's file
  std::string vehicle = {};
  std::vector<std::string> notes = {};  ///< for people: what of a log is missing
  const Scenario* scenario = nullptr;   ///< resolved; null if not known
  SceneSetting scene = {};
  std::vector<ParameterDescription> parameters = {};
  std::vector<std::string> publishable = {};
  std::vector<Scenario> members = {};  ///< members of a fleet; empty for a single vehicle

  /// Takes the values that follow from its scenario, which must outlive this; of a fleet, the scene
  /// and `vehicle` are the first one's.
  void take(const Scenario& of_the_run);
  /// The scenario of the first vehicle; there must be one.
  const Scenario& first() const { return members.empty() ? *scenario : members.front(); }
  /// The names of all; at least one.
  std::vector<std::string> vehicles() const;
};
std::string run_json(const RunDescription& run);

/// Descriptions of playback.position_s and similar parameters, `can_jump`: as in a log, not in a
/// run that is computed.
std::vector<ParameterDescription> playback_descriptions(double start_s, double end_s,
                                                        bool can_jump);

}  // namespace tether
