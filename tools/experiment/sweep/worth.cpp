#include "tools/experiment/sweep/worth.hpp"

#include <algorithm>
#include <cmath>

namespace tether {
namespace {

double mean_over_conditions(const WorthRule& rule, const std::vector<double>& means) {
  double sum = 0.0;
  for (const double mean : means) sum += rule.is_geometric ? std::log(mean) : mean;
  const double mean = sum / static_cast<double>(means.size());
  return rule.is_geometric ? std::exp(mean) : mean;
}

}  // namespace

double Worth::objective(Aim aim) const {
  if (aim == Aim::error) return error;
  const double below_one =
      std::isfinite(survivors_error) ? survivors_error / (1.0 + survivors_error) : 1.0;
  return static_cast<double>(lost) + below_one;
}

Worth worth_of(const WorthRule& rule, const std::vector<std::vector<TunedRun>>& runs) {
  Worth worth;
  std::vector<double> survivors_means;
  for (const std::vector<TunedRun>& of_condition : runs) {
    double sum = 0.0, survivors_sum = 0.0;
    std::size_t lost = 0;
    for (const TunedRun& run : of_condition) {
      const double value = std::isfinite(run.metric) ? std::min(run.metric, rule.most) : rule.most;
      sum += value;
      if (run.lost) {
        ++lost;
      } else {
        survivors_sum += value;
      }
    }
    const std::size_t survivors = of_condition.size() - lost;
    worth.means.push_back(sum / static_cast<double>(of_condition.size()));
    survivors_means.push_back(survivors == 0 ? rule.most
                                             : survivors_sum / static_cast<double>(survivors));
    worth.lost_by_condition.push_back(lost);
    worth.lost += lost;
    worth.n += of_condition.size();
  }
  worth.error = mean_over_conditions(rule, worth.means);
  worth.survivors_error = mean_over_conditions(rule, survivors_means);
  return worth;
}

}  // namespace tether
