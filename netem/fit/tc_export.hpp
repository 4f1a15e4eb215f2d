#pragma once

#include "netem/link/link_config.hpp"
#include "netem/link/tc.hpp"

namespace tether {

/// `link` is as scenario loading leaves it.
TcExport export_tc(const LinkConfig& link, const TcSender& sender);

}  // namespace tether
