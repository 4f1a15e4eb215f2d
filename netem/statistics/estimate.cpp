#include "netem/statistics/estimate.hpp"

#include <boost/math/distributions/beta.hpp>
#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <cassert>

namespace tether {

namespace math = boost::math;

double normal_quantile(double confidence) {
  assert(confidence > 0.0 && confidence < 1.0);
  return math::quantile(math::complement(math::normal(), 0.5 * (1.0 - confidence)));
}

double student_quantile(double confidence, double degrees_of_freedom) {
  assert(confidence > 0.0 && confidence < 1.0);
  return math::quantile(
      math::complement(math::students_t(degrees_of_freedom), 0.5 * (1.0 - confidence)));
}

Estimate proportion_interval(double successes, double trials, double confidence) {
  if (!(trials > 0.0)) return {};
  const double failures = trials - successes;
  assert(successes >= 0.0 && failures >= 0.0);
  const double tail = 0.5 * (1.0 - confidence);
  Estimate e{successes / trials, 0.0, 1.0, trials};
  if (successes > 0.0)
    e.low = math::quantile(math::beta_distribution<>(successes, failures + 1.0), tail);
  if (failures > 0.0) {
    e.high = math::quantile(
        math::complement(math::beta_distribution<>(successes + 1.0, failures), tail));
  }
  return e;
}

Estimate mean_time_interval(double events, double exposure, double confidence) {
  if (!(exposure > 0.0)) return {};
  const double tail = 0.5 * (1.0 - confidence);
  Estimate e;
  e.effective_samples = events;
  e.low = 2.0 * exposure /
          math::quantile(math::complement(math::chi_squared(2.0 * events + 2.0), tail));
  if (events > 0.0) {
    e.value = exposure / events;
    e.high = 2.0 * exposure / math::quantile(math::chi_squared(2.0 * events), tail);
  }
  return e;
}

}  // namespace tether
