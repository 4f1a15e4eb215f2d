#include "netem/stages/delay_law.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <boost/math/special_functions/erf.hpp>
#include <charconv>
#include <cmath>
#include <fstream>
#include <numbers>
#include <string>

#include "common/base/errors.hpp"
#include "common/base/file_store.hpp"
#include "common/base/input_file.hpp"
#include "common/base/text.hpp"

namespace tether {
namespace {

using Form = JitterLaw::Form;

// long double inside Boost.Math would cost five times as much for digits that are not used.
using Fast = boost::math::policies::policy<boost::math::policies::promote_double<false>>;

constexpr std::size_t kMaxTable = 1'000'000;

double upper_tail(double z) { return 0.5 * std::erfc(z / std::numbers::sqrt2); }

template <std::size_t N>
double polynomial(const double (&c)[N], double x) {
  double sum = c[N - 1];
  for (std::size_t i = N - 1; i-- > 0;) sum = sum * x + c[i];
  return sum;
}

/// Φ⁻¹(u), 0 < u < 1: AS 241, function PPND16, with Boost.Math where |z| > 6.6.
double normal_score(double u) {
  static constexpr double kA[] = {3.3871328727963666080e0, 1.3314166789178437745e2,
                                  1.9715909503065514427e3, 1.3731693765509461125e4,
                                  4.5921953931549871457e4, 6.7265770927008700853e4,
                                  3.3430575583588128105e4, 2.5090809287301226727e3};
  static constexpr double kB[] = {1.0,
                                  4.2313330701600911252e1,
                                  6.8718700749205790830e2,
                                  5.3941960214247511077e3,
                                  2.1213794301586595867e4,
                                  3.9307895800092710610e4,
                                  2.8729085735721942674e4,
                                  5.2264952788528545610e3};
  static constexpr double kC[] = {1.42343711074968357734e0,  4.63033784615654529590e0,
                                  5.76949722146069140550e0,  3.64784832476320460504e0,
                                  1.27045825245236838258e0,  2.41780725177450611770e-1,
                                  2.27238449892691845833e-2, 7.74545014278341407640e-4};
  static constexpr double kD[] = {1.0,
                                  2.05319162663775882187e0,
                                  1.67638483018380384940e0,
                                  6.89767334985100004550e-1,
                                  1.48103976427480074590e-1,
                                  1.51986665636164571966e-2,
                                  5.47593808499534494600e-4,
                                  1.05075007164441684324e-9};
  const double q = u - 0.5;
  if (std::abs(q) <= 0.425) {
    const double r = 0.180625 - q * q;
    return q * polynomial(kA, r) / polynomial(kB, r);
  }
  const double tail = std::sqrt(-std::log(q < 0.0 ? u : 1.0 - u));
  if (tail > 5.0) return -std::numbers::sqrt2 * boost::math::erfc_inv(2.0 * u, Fast());
  const double z = polynomial(kC, tail - 1.6) / polynomial(kD, tail - 1.6);
  return q < 0.0 ? -z : z;
}

std::vector<double> read_delay_table(const std::string& file) {
  std::ifstream in = open_input(file, "the delay table", kMostTableBytes);
  std::vector<double> table_ms;
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    const auto first = line.find_first_not_of(" \t\r");
    if (first == std::string::npos || line[first] == '#') continue;
    const auto last = line.find_last_not_of(" \t\r") + 1;
    double value = 0.0;
    const auto [end, failed] = std::from_chars(line.data() + first, line.data() + last, value);
    if (failed != std::errc{} || end != line.data() + last || !(std::abs(value) <= 1e6)) {
      throw UsageError(fmt::format(
          "{}:{}: \"{}\" is not a delay: must be a number in [-1e6, 1e6] "
          "(milliseconds)",
          file, number,
          printable(std::string_view(line).substr(first, last - first), kLongestValueShown)));
    }
    if (table_ms.size() == kMaxTable) {
      throw UsageError(fmt::format("{}:{}: more than {} delays", file, number, kMaxTable));
    }
    table_ms.push_back(value);
  }
  if (table_ms.size() < 2) {
    throw UsageError(fmt::format("{}: a delay table needs two or more delays", file));
  }
  std::sort(table_ms.begin(), table_ms.end());
  return table_ms;
}

}  // namespace

DelayLaw::DelayLaw(const JitterSettings& settings, const std::vector<double>& table_ms)
    : form_(jitter_law(settings).form),
      mean_s_(settings.mean_ms * 1e-3),
      sd_s_(settings.sd_ms * 1e-3) {
  if (form_ == Form::quantiles) {
    for (const double ms : table_ms) table_.push_back(ms * 1e-3);
  } else if (sd_s_ <= 0.0) {
    form_ = Form::constant;
  } else if (form_ == Form::scores) {
    table_ = jitter_law(settings).tabulate(settings, mean_s_, sd_s_);
  }
}

double DelayLaw::between(double position) const {
  const double last = static_cast<double>(table_.size() - 1);
  position = std::clamp(position * last, 0.0, last);
  const auto i = std::min(static_cast<std::size_t>(position), table_.size() - 2);
  return table_[i] + (position - static_cast<double>(i)) * (table_[i + 1] - table_[i]);
}

double DelayLaw::at_score(double z) const {
  switch (form_) {
    case Form::constant:
      return mean_s_;
    case Form::normal:
      return mean_s_ + sd_s_ * z;
    case Form::quantiles:
      return between(upper_tail(-z));
    case Form::scores:
      break;
  }
  return between(0.5 * (z / kMaxScore + 1.0));
}

std::vector<double> load_delay_table(const JitterSettings& settings) {
  if (jitter_law(settings).form != Form::quantiles) return {};
  if (settings.file.empty()) return settings.table_ms;
  static FileStore<std::vector<double>> store(read_delay_table);
  return *store.get(settings.file);
}

double draw_normal_score(RandomEngine& random) {
  // Midpoints of 2^52 equal cells: never 0 nor 1, and exact also when subtracted from 1.
  const double u = (static_cast<double>(random() >> 12) + 0.5) * 0x1p-52;
  return normal_score(u);
}

DelaySequence::DelaySequence(const DelayLaw& law, double correlation, RandomEngine random)
    : law_(law),
      keep_(correlation),
      renew_(std::sqrt(1.0 - correlation * correlation)),
      random_(random) {}

void DelaySequence::set(const DelayLaw& law, double correlation) {
  law_ = law;
  keep_ = correlation;
  renew_ = std::sqrt(1.0 - correlation * correlation);
}

Duration DelaySequence::next() {
  constexpr double kLongest_s = 1e6;
  const double fresh = draw_normal_score(random_);
  score_ = begun_ ? keep_ * score_ + renew_ * fresh : fresh;
  begun_ = true;
  return from_seconds(std::clamp(law_.at_score(score_), -kLongest_s, kLongest_s));
}

}  // namespace tether
