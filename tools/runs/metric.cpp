#include "tools/runs/metric.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <muParser.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "common/base/errors.hpp"
#include "common/base/nearest_name.hpp"
#include "tools/runs/run_observer.hpp"

namespace tether {
namespace {

[[noreturn]] void refuse(const std::string& why) {
  throw UsageError(
      fmt::format("one of {}, or an expression over them{}", fmt::join(metric_names(), ", "), why));
}

}  // namespace

struct MetricExpression::Parsed {
  mu::Parser parser;
  std::vector<double> values = std::vector<double>(metrics().size(), 1.0);
  std::vector<std::size_t> used;  ///< places in metrics()
};

MetricExpression::MetricExpression(const std::string& text)
    : parsed_(std::make_unique<Parsed>()), label_(text) {
  if (const auto number = metric_number(text)) {
    parsed_->used = {*number};
    is_error_ = metrics()[*number].is_error;
    is_share_ = metrics()[*number].is_share;
    label_ = metrics()[*number].label;
  }
  try {
    for (std::size_t i = 0; i < metrics().size(); ++i) {
      parsed_->parser.DefineVar(metrics()[i].name, &parsed_->values[i]);
    }
    parsed_->parser.SetExpr(text);
    for (const auto& [name, place] : parsed_->parser.GetUsedVar()) {
      const auto number = metric_number(name);
      if (!number) {
        refuse(fmt::format(": \"{}\" is none (did you mean \"{}\"?)", name,
                           nearest_name(metric_names(), name)));
      }
      if (!metric_number(text)) parsed_->used.push_back(*number);
      is_error_ = is_error_ || metrics()[*number].is_error;
    }
    int results = 0;
    parsed_->parser.Eval(results);
    if (results != 1) refuse(": it has to be one number");
  } catch (const mu::ParserError& error) {
    refuse(": " + error.GetMsg());
  }
  if (parsed_->used.empty()) refuse(": there is none in it");
}

MetricExpression::MetricExpression(MetricExpression&&) noexcept = default;
MetricExpression::~MetricExpression() = default;

double MetricExpression::of(const std::vector<double>& all) const {
  for (const std::size_t number : parsed_->used) {
    if (std::isnan(all[number])) return std::numeric_limits<double>::quiet_NaN();
  }
  parsed_->values = all;  // the same place: the parser has pointers to it
  return parsed_->parser.Eval();
}

namespace {

constexpr auto kFirst = Metric::InSummary::first, kLast = Metric::InSummary::last,
               kElsewhere = Metric::InSummary::not_here;

constexpr bool kIsError = true, kIsShare = true;

constexpr auto kLargest = Metric::OverFleet::largest, kSum = Metric::OverFleet::sum;

/// Half of one in which two vehicles take part is each one's.
double collisions(const RunObserver& run) {
  return 0.5 * static_cast<double>(run.counter("sim.collisions"));
}

/// Busy share of Wi-Fi, or of a cell's uplink. One vehicle of a fleet counts it for all.
double medium_busy(const RunObserver& run, Instant end) {
  const std::int64_t busy_us =
      run.counter("netem.medium.busy_us") + run.counter("netem.medium.up.busy_us");
  return end > kStart ? 1e-6 * static_cast<double>(busy_us) / to_seconds(end) : 0.0;
}

double sent(const link_report_t& link) { return static_cast<double>(link.offered); }
double lost(const link_report_t& link) { return static_cast<double>(link.lost + link.overflowed); }

Metric of_link(const char* name, double (*of)(const RunObserver& run, Instant end)) {
  return {name, name, kElsewhere, of};
}

}  // namespace

const std::vector<Metric>& metrics() {
  using Run = const RunObserver&;
  static const std::vector<Metric> kMetrics{
      {"epsilon_m", "ε [m]", kFirst, [](Run r, Instant) { return r.truth().epsilon_m; }, kIsError},
      {"rmse_m", "rms error [m]", kFirst, [](Run r, Instant) { return r.truth().rmse_m; },
       kIsError},
      {"max_error_m", "largest error [m]", kFirst,
       [](Run r, Instant) { return r.truth().max_error_m; }, kIsError},
      {"wall_contact_s", "time at the walls [s]", kFirst,
       [](Run r, Instant) { return r.truth().wall_contact_s; }},
      {"settled_epsilon_m", "ε after the start [m]", kFirst,
       [](Run r, Instant) { return r.truth().settled_epsilon_m; }, kIsError},
      {"settled_max_error_m", "largest error after the start [m]", kFirst,
       [](Run r, Instant) { return r.truth().settled_max_error_m; }, kIsError},
      {"lost", "share of lost vehicles", kElsewhere,
       [](Run r, Instant) { return r.truth().lost ? 1.0 : 0.0; }, false, false, kLargest},
      {"lost_from_s", "time until lost or the end [s]", kElsewhere,
       [](Run r, Instant) { return r.truth().lost_from_s; }},
      {"return_s", "longest time to return [s]", kFirst,
       [](Run r, Instant) { return r.truth().return_s; }},
      {"away_s", "time away at the end [s]", kFirst,
       [](Run r, Instant) { return r.truth().away_s; }},
      {"autonomous", "share autonomous at the end", kElsewhere,
       [](Run r, Instant) {
         return r.autonomy() && r.autonomy()->state == autonomy_state_t::AUTONOMOUS ? 1.0 : 0.0;
       },
       false, kIsShare},
      {"late_s", "late on its path at the end [s]", kElsewhere,
       [](Run r, Instant) { return r.autonomy() ? r.autonomy()->late_s : 0.0; }},
      {"aoi_ms_mean", "aoi_ms_mean", kLast,
       [](Run r, Instant end) { return r.aoi_mean_s(end) * 1e3; }},
      of_link("uplink_sent", [](Run r, Instant) { return sent(r.uplink()); }),
      of_link("uplink_lost", [](Run r, Instant) { return lost(r.uplink()); }),
      of_link("uplink_delay_ms_mean", [](Run r, Instant) { return r.uplink().delay_ms_mean; }),
      of_link("uplink_delay_ms_p50", [](Run r, Instant) { return r.uplink().delay_ms_p50; }),
      of_link("uplink_delay_ms_p99", [](Run r, Instant) { return r.uplink().delay_ms_p99; }),
      of_link("uplink_delay_ms_max", [](Run r, Instant) { return r.uplink().delay_ms_max; }),
      of_link("downlink_sent", [](Run r, Instant) { return sent(r.downlink()); }),
      of_link("downlink_lost", [](Run r, Instant) { return lost(r.downlink()); }),
      of_link("downlink_delay_ms_mean", [](Run r, Instant) { return r.downlink().delay_ms_mean; }),
      of_link("downlink_delay_ms_p50", [](Run r, Instant) { return r.downlink().delay_ms_p50; }),
      of_link("downlink_delay_ms_p99", [](Run r, Instant) { return r.downlink().delay_ms_p99; }),
      of_link("downlink_delay_ms_max", [](Run r, Instant) { return r.downlink().delay_ms_max; }),
      {"medium_busy", "share of the medium's time that is taken", kElsewhere,
       [](Run r, Instant end) { return medium_busy(r, end); }, false, false, kSum},
      {"vehicles_lost", "share of the fleet's vehicles that were lost", kElsewhere,
       [](Run r, Instant) { return r.truth().lost ? 1.0 : 0.0; }},
      {"worst_settled_epsilon_m", "ε of the worst, after the start [m]", kElsewhere,
       [](Run r, Instant) { return r.truth().settled_epsilon_m; }, kIsError, false, kLargest},
      {"collisions", "collisions with other vehicles", kElsewhere,
       [](Run r, Instant) { return collisions(r); }, false, false, kSum},
  };
  return kMetrics;
}

double value_of(const Metric& metric, const std::vector<const RunObserver*>& vehicles,
                Instant end) {
  std::vector<double> values;
  for (const RunObserver* vehicle : vehicles) values.push_back(metric.of(*vehicle, end));
  if (metric.over_fleet == kLargest) return *std::max_element(values.begin(), values.end());
  const double sum = std::accumulate(values.begin(), values.end(), 0.0);
  return metric.over_fleet == kSum ? sum : sum / static_cast<double>(values.size());
}

std::vector<std::string> metric_names() {
  std::vector<std::string> names;
  for (const Metric& metric : metrics()) names.push_back(metric.name);
  return names;
}

std::optional<std::size_t> metric_number(std::string_view name) {
  const auto found = std::find_if(metrics().begin(), metrics().end(),
                                  [name](const Metric& metric) { return metric.name == name; });
  if (found == metrics().end()) return std::nullopt;
  return static_cast<std::size_t>(found - metrics().begin());
}

}  // namespace tether
