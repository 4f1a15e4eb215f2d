#include "netem/link/tc.hpp"

#include <fmt/format.h>

namespace tether {

std::string tc_percent(double probability) { return fmt::format("{:.10g}%", 100.0 * probability); }

std::string tc_time(double milliseconds) { return fmt::format("{:.10g}ms", milliseconds); }

std::string tc_random_loss(double loss) {
  return loss > 0.0 ? " loss random " + tc_percent(loss) : "";
}

double loss_of_either(double loss, double other) { return loss + (1.0 - loss) * other; }

double frame_overhead_bytes(const std::string& channel) {
  constexpr double kEthernet = 14.0, kIpv4 = 20.0, kUdp = 8.0;
  constexpr double kLcm = 8.0;  // magic and sequence number, then the channel's name and a zero
  return kEthernet + kIpv4 + kUdp + kLcm + static_cast<double>(channel.size()) + 1.0;
}

}  // namespace tether
