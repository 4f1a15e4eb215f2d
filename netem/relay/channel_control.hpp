#pragma once

#include <functional>
#include <string>
#include <vector>

#include "netem/channel/change.hpp"
#include "netem/channel/models.hpp"
#include "netem/channel/use.hpp"
#include "netem/link/link.hpp"

namespace tether {

/// Changes the settings of links that are in use, all that are asked for or none.
class ChannelControl {
 public:
  /// `models`: the links', which are those of `use`.
  ChannelControl(const NetemSettings& settings, ChannelModels models,
                 ChannelUse use = kVehicleLinks)
      : in_force_(settings), models_(std::move(models)), use_(std::move(use)) {}

  /// With the channel's settings as they are now.
  const NetemSettings& in_force() const { return in_force_; }

  /// Settings of the links in use that differ from the defaults.
  std::vector<ChannelSetting> settings() const;

  /// Gives the links these settings ("downlink.prr=0.45": netem/channel/change.hpp)
  /// from their next packet on; Link::apply() and renew_models() say what stays. `links`: in the
  /// order of the use. Returns what was asked for or became another. Reads files. Throws,
  /// UsageError with the reason for what is not allowed or of no effect on these links, and then
  /// nothing has changed.
  std::vector<ChannelSetting> change(const std::vector<std::string>& settings, Instant now,
                                     const std::vector<Link*>& links);

  /// Slow part of change(), which reads files, as work for a thread of its own: they are
  /// kept then. None if no file is needed, or if change() refuses the settings anyway.
  std::function<void()> reading(const std::vector<std::string>& settings) const;

 private:
  ChannelChange wanted(const std::vector<std::string>& settings) const;

  NetemSettings in_force_;
  ChannelModels models_;
  ChannelUse use_;
};

/// Whether all of channel.change can be done, files and chains included. Throws UsageError.
void try_changes(const NetemSettings& settings, const ChannelUse& use = kVehicleLinks);

}  // namespace tether
