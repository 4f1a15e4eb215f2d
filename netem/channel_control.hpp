#pragma once

#include <string>
#include <vector>

#include "common/channel_settings.hpp"
#include "netem/channel_models.hpp"
#include "netem/link.hpp"

namespace tether {

/// Changes the settings of two links that are in use, all that are asked for or none.
class ChannelControl {
 public:
  /// `models`: the links'.
  ChannelControl(const Scenario& scenario, ChannelModels models)
      : in_force_(scenario), models_(std::move(models)) {}

  /// With the channel's settings as they are now.
  const Scenario& in_force() const { return in_force_; }

  /// Gives the links these settings ("downlink.prr=0.45": common/channel_settings.hpp) from their
  /// next packet on; Link::apply() and renew_models() say what stays. Returns what was asked for or
  /// became another. Reads files. Throws, UsageError with the reason for what is not allowed, and
  /// then nothing has changed.
  std::vector<ChannelSetting> change(const std::vector<std::string>& settings, Instant now,
                                     Link& uplink, Link& downlink);

 private:
  Scenario in_force_;
  ChannelModels models_;
};

/// Whether all of channel.change can be done, files and chains included. Throws UsageError.
void try_changes(const Scenario& scenario);

}  // namespace tether
