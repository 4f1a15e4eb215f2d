#include "tools/processes/dashboard.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/path/kinds.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "tools/processes/braille_map.hpp"
#include "tools/runs/run_summary.hpp"

namespace tether {
namespace {

constexpr int kMapRows = Dashboard::kRows - 1;  // and its title
constexpr int kMapColumns = 2 * kMapRows;
constexpr std::size_t kFactColumns = Dashboard::kColumns - kMapColumns - 3;
constexpr double kTrail_s = 20.0;
constexpr int kPathDots = 2000;

double prr(const link_report_t& link) { return link.offered > 0 ? reception_ratio(link) : 1.0; }

/// "-" where there is none.
std::string known(double value, int digits, const char* unit) {
  return std::isfinite(value) ? fmt::format("{:.{}f}{}", value, digits, unit) : "-";
}

std::string link_line(const char* name, const link_report_t& link, const RecentLink::Seen& seen) {
  return fmt::format("{:<9} PRR {:>4} {:>7} {:3.0f}/s   run {:.2f}", name, known(seen.prr, 2, ""),
                     known(seen.delay_ms, 0, " ms"), seen.per_s, prr(link));
}

/// ASCII only is cut by bytes; a cut within a longer character would garble the terminal.
std::string cut(std::string text) {
  if (text.size() <= kFactColumns) return text;
  text.resize(kFactColumns - 1);
  while (!text.empty() && (static_cast<unsigned char>(text.back()) & 0xc0U) == 0x80U) {
    text.pop_back();
  }
  if (!text.empty() && static_cast<unsigned char>(text.back()) >= 0xc0U) text.pop_back();
  return text + "…";
}

}  // namespace

Dashboard::Dashboard(const Scenario& scenario)
    : name_(scenario.get<VehicleSettings>().name),
      duration_s_(scenario.get<RunSettings>().duration_s),
      half_extent_m_(scenario.get<WorldSettings>().half_extent_m) {
  const auto path = make_path(scenario.get<PathSettings>());
  double farthest_m = 0.0;
  for (int i = 0; i <= kPathDots; ++i) {
    path_.push_back(path->position_at(duration_s_ * i / kPathDots));
    farthest_m = std::max({farthest_m, std::abs(path_.back().x_m), std::abs(path_.back().y_m)});
  }
  // Walls far from the path would leave it a dot.
  constexpr double kMargin = 1.2, kLeast_m = 1.0;
  half_extent_m_ = std::min(half_extent_m_, std::max(kMargin * farthest_m, kLeast_m));
}

double Dashboard::left_s(const Moment& moment) const {
  return std::max(0.0, duration_s_ - moment.t_s);
}

std::string Dashboard::line(const RunObserver& run, const Moment& moment) const {
  const ground_truth_t& truth = run.truth();
  std::string text = fmt::format("{:4.0f} s left  ", left_s(moment));
  if (!moment.fleet.empty()) {
    text += fmt::format("{}", fmt::join(moment.fleet, "   "));
  } else {
    text += fmt::format("{:5.1f}, {:5.1f} m  error {:5.2f} m", truth.x_m, truth.y_m, truth.error_m);
    for (const auto& [name, seen] :
         {std::pair("up", moment.uplink), std::pair("down", moment.downlink)}) {
      text += fmt::format("  {} {:>4} {:>6}", name, known(seen.prr, 2, ""),
                          known(seen.delay_ms, 0, " ms"));
    }
  }
  if (!moment.drives.empty()) text += "   drives " + moment.drives;
  for (const std::string& silent : moment.silent) text += "   " + silent;
  if (moment.silent.empty() && !moment.findings.empty()) text += "   INVALID";
  return text;
}

std::string Dashboard::map_title() const {
  return fmt::format("{:<{}}",
                     fmt::format("{:.0f} m by {:.0f} m", 2 * half_extent_m_, 2 * half_extent_m_),
                     kMapColumns);
}

std::vector<std::string> Dashboard::map(const RunObserver& run, const Moment& moment) const {
  BrailleMap map(kMapRows, half_extent_m_);
  for (const Position& p : path_) map.faint_dot(p.x_m, p.y_m);
  const auto& rows = run.trajectory();
  for (auto row = rows.rbegin(); row != rows.rend() && row->t_s > moment.t_s - kTrail_s; ++row) {
    map.bright_dot(row->x_m, row->y_m);
  }
  const ground_truth_t& truth = run.truth();
  for (const Position& other : moment.others) map.bright_dot(other.x_m, other.y_m);
  map.arrow(truth.x_m, truth.y_m, truth.yaw_rad);
  return map.lines();
}

std::vector<std::string> Dashboard::facts(const RunObserver& run, const Moment& moment) const {
  const ground_truth_t& truth = run.truth();
  std::vector<std::string> all{
      fmt::format("t {:.1f} of {:.0f} s, {:.0f} s left", moment.t_s, duration_s_, left_s(moment)),
      fmt::format("ε {:.3f} m   now {:.3f} m at {:.1f}, {:.1f}", truth.epsilon_m, truth.error_m,
                  truth.x_m, truth.y_m),
      fmt::format("in the last {:.0f} s:", RecentLink::kWindow_s),
      link_line("uplink", run.uplink(), moment.uplink),
      link_line("downlink", run.downlink(), moment.downlink),
      fmt::format("{:<9} {:.0f} ms, mean", "pose age",
                  1000.0 * run.aoi_mean_s(kStart + from_seconds(std::max(0.0, moment.t_s))))};
  if (!moment.fleet.empty()) {
    all[1] = name_ + ": " + all[1];
    all.insert(all.begin() + 1, moment.fleet.begin(), moment.fleet.end());
    all.insert(all.begin() + 1, "");
    all.insert(all.begin() + 2 + static_cast<std::ptrdiff_t>(moment.fleet.size()), "");
  }
  if (!moment.drives.empty()) all.push_back(fmt::format("{:<9} {}", "drives", moment.drives));
  all.emplace_back("");
  for (const std::string& silent : moment.silent) all.push_back(silent);
  all.emplace_back(moment.findings.empty() ? "valid so far" : "\033[1mINVALID\033[0m");
  for (const std::string& finding : moment.findings) all.push_back(finding);
  if (all.size() > kMapRows) all.resize(kMapRows);
  for (std::string& fact : all) fact = cut(std::move(fact));
  return all;
}

std::vector<std::string> Dashboard::lines(const RunObserver& run, const Moment& moment) const {
  std::vector<std::string> all = map(run, moment);
  const std::vector<std::string> beside = facts(run, moment);
  for (std::size_t i = 0; i < beside.size(); ++i) all[i] += "   " + beside[i];
  all.push_back(map_title());
  return all;
}

}  // namespace tether
