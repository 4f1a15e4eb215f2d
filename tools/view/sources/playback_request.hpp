#pragma once

#include <string>
#include <vector>

#include "tools/view/server/hub.hpp"

namespace tether {

// Requests of clients to a playback. All throw UsageError that names the parameter and what is
// allowed.

/// Parameters of a request to set some; others are refused.
const std::vector<Parameter>& parameters_of(const ViewRequest& request);

bool switch_of(const Parameter& parameter);
/// In [low, high].
double number_of(const Parameter& parameter, double low, double high);

[[noreturn]] void refuse_parameter(const Parameter& parameter, const std::string& why);

}  // namespace tether
