#include "netem/link/tc.hpp"

#include <fmt/format.h>

namespace tether {

std::string tc_percent(double probability) { return fmt::format("{:.10g}%", 100.0 * probability); }

std::string tc_time(double milliseconds) { return fmt::format("{:.10g}ms", milliseconds); }

std::string tc_random_loss(double loss) {
  return loss > 0.0 ? " loss random " + tc_percent(loss) : "";
}

double loss_of_either(double loss, double other) { return 1.0 - (1.0 - loss) * (1.0 - other); }

}  // namespace tether
