#include "tools/runs/metric.hpp"

#include <algorithm>

#include "tools/runs/run_observer.hpp"

namespace tether {
namespace {

constexpr auto kFirst = Metric::InSummary::first, kLast = Metric::InSummary::last,
               kWithLink = Metric::InSummary::not_here;

double sent(const link_report_t& link) { return static_cast<double>(link.offered); }
double lost(const link_report_t& link) { return static_cast<double>(link.lost + link.overflowed); }

}  // namespace

const std::vector<Metric>& metrics() {
  using Run = const RunObserver&;
  static const std::vector<Metric> kMetrics{
      {"epsilon_m", "ε [m]", kFirst, [](Run r, Instant) { return r.truth().epsilon_m; }},
      {"rmse_m", "rms error [m]", kFirst, [](Run r, Instant) { return r.truth().rmse_m; }},
      {"max_error_m", "largest error [m]", kFirst,
       [](Run r, Instant) { return r.truth().max_error_m; }},
      {"wall_contact_s", "time at the walls [s]", kFirst,
       [](Run r, Instant) { return r.truth().wall_contact_s; }},
      {"aoi_ms_mean", "aoi_ms_mean", kLast,
       [](Run r, Instant end) { return r.aoi_mean_s(end) * 1e3; }},
      {"uplink_sent", "uplink_sent", kWithLink, [](Run r, Instant) { return sent(r.uplink()); }},
      {"uplink_lost", "uplink_lost", kWithLink, [](Run r, Instant) { return lost(r.uplink()); }},
      {"uplink_delay_ms_mean", "uplink_delay_ms_mean", kWithLink,
       [](Run r, Instant) { return r.uplink().delay_ms_mean; }},
      {"downlink_sent", "downlink_sent", kWithLink,
       [](Run r, Instant) { return sent(r.downlink()); }},
      {"downlink_lost", "downlink_lost", kWithLink,
       [](Run r, Instant) { return lost(r.downlink()); }},
      {"downlink_delay_ms_mean", "downlink_delay_ms_mean", kWithLink,
       [](Run r, Instant) { return r.downlink().delay_ms_mean; }},
  };
  return kMetrics;
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
