#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "tools/margin/verification.hpp"

namespace tether {

/// The head of a table of critical values; then a row of it: predicted and simulated values, their
/// 95 % intervals, by how much they are off, and why there is none.
std::string verification_head();
std::string verification_row(const std::string& arm, const VerifiedCritical& row);
nlohmann::ordered_json verification_json(const std::string& arm, const VerifiedCritical& row);

}  // namespace tether
