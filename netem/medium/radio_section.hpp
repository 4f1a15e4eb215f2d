#pragma once

#include <string>

#include "common/scenario/key_table.hpp"
#include "netem/medium/medium_settings.hpp"

namespace tether {

/// SNR of stations.
inline constexpr Range kSnrRange_db{-50.0, 100.0, false};

/// The keys of [medium.radio].
void radio_link_keys(KeyTable<RadioSettings> table, KeyTable<MediumSettings>& medium);

/// Why `key`, a part behind "medium.radio.", has no effect; "" if it has one.
std::string why_no_effect_on_radio(const MediumSettings& medium, const std::string& key);

/// Throws UsageError, which begins with `file`, for what does not go together.
void check_radio(const MediumSettings& medium, const std::string& file);

}  // namespace tether
