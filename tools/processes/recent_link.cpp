#include "tools/processes/recent_link.hpp"

namespace tether {

void RecentLink::add(double t_s, const link_report_t& report, std::int64_t heard) {
  if (!counts_.empty() && report.offered < counts_.back().offered) counts_.clear();
  counts_.push_back({t_s, report.offered, report.lost + report.overflowed, report.delivered, heard,
                     report.delay_ms_mean * static_cast<double>(report.delivered)});
  while (counts_.size() > 2 && counts_[1].t_s <= t_s - kWindow_s) counts_.pop_front();
}

RecentLink::Seen RecentLink::seen() const {
  Seen seen;
  if (counts_.empty()) return seen;
  const Count &first = counts_.front(), &last = counts_.back();
  const auto offered = static_cast<double>(last.offered - first.offered);
  const auto delivered = static_cast<double>(last.delivered - first.delivered);
  if (offered > 0.0) seen.prr = 1.0 - static_cast<double>(last.missing - first.missing) / offered;
  if (delivered > 0.0) seen.delay_ms = (last.delays_ms - first.delays_ms) / delivered;
  if (last.t_s > first.t_s) {
    seen.per_s = static_cast<double>(last.heard - first.heard) / (last.t_s - first.t_s);
  }
  return seen;
}

}  // namespace tether
