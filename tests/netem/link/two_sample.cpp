#include "tests/netem/link/two_sample.hpp"

#include <algorithm>
#include <boost/math/distributions/chi_squared.hpp>
#include <cmath>
#include <numbers>

namespace tether::test {
namespace {

double smirnov_tail(double lambda) {
  if (lambda < 0.2) return 1.0;  // there it is 1 to 12 digits, and the series is slow
  double sum = 0.0;
  for (int k = 1; k <= 100; ++k) {
    sum += (k % 2 == 1 ? 2.0 : -2.0) * std::exp(-2.0 * k * k * lambda * lambda);
  }
  return std::clamp(sum, 0.0, 1.0);
}

}  // namespace

double same_ratio(std::int64_t first, std::int64_t second, std::int64_t n, double ratio_sd) {
  const double difference = static_cast<double>(first - second) / static_cast<double>(n);
  return std::erfc(std::abs(difference) / (std::numbers::sqrt2 * ratio_sd) / std::numbers::sqrt2);
}

double ChiSquare::probability(double inflation) const {
  if (degrees_of_freedom == 0) return 1.0;
  const boost::math::chi_squared law(degrees_of_freedom);
  return cdf(complement(law, sum / inflation));
}

ChiSquare same_histogram(const std::vector<std::int64_t>& first,
                         const std::vector<std::int64_t>& second, std::int64_t least) {
  struct Class {
    double first = 0.0, second = 0.0;
  };
  const auto at = [](const std::vector<std::int64_t>& histogram, std::size_t i) {
    return i < histogram.size() ? static_cast<double>(histogram[i]) : 0.0;
  };
  std::vector<Class> classes;
  Class all, open;
  for (std::size_t i = 0; i < std::max(first.size(), second.size()); ++i) {
    open = {open.first + at(first, i), open.second + at(second, i)};
    all = {all.first + at(first, i), all.second + at(second, i)};
    if (open.first + open.second < static_cast<double>(least)) continue;
    classes.push_back(open);
    open = {};
  }
  if (!classes.empty()) {
    classes.back() = {classes.back().first + open.first, classes.back().second + open.second};
  }
  ChiSquare result;
  if (classes.size() < 2 || all.first == 0.0 || all.second == 0.0) return result;
  const double share = all.first / (all.first + all.second);
  for (const Class& c : classes) {
    const double expected = share * (c.first + c.second);
    const double difference = c.first - expected;
    result.sum += difference * difference * (1.0 / expected + share / (1.0 - share) / expected);
  }
  result.degrees_of_freedom = static_cast<int>(classes.size()) - 1;
  return result;
}

KolmogorovSmirnov same_law(std::vector<double> first, std::vector<double> second) {
  std::sort(first.begin(), first.end());
  std::sort(second.begin(), second.end());
  const auto n = static_cast<double>(first.size());
  const auto m = static_cast<double>(second.size());
  KolmogorovSmirnov result;
  std::size_t i = 0, j = 0;
  while (i < first.size() && j < second.size()) {
    const double x = std::min(first[i], second[j]);
    while (i < first.size() && first[i] <= x) ++i;
    while (j < second.size() && second[j] <= x) ++j;
    result.distance = std::max(result.distance,
                               std::abs(static_cast<double>(i) / n - static_cast<double>(j) / m));
  }
  result.probability = smirnov_tail(result.distance * std::sqrt(n * m / (n + m)));
  return result;
}

}  // namespace tether::test
