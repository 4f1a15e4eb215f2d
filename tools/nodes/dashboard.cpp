#include "tools/nodes/dashboard.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <numbers>
#include <utility>

#include "common/path/kinds.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "tools/runs/run_summary.hpp"

namespace tether {
namespace {

constexpr int kDotsAcross = 2, kDotsDown = 4;
/// Unicode 15, section 21.1: the bit of each dot, by row and column.
constexpr std::array<std::array<std::uint8_t, kDotsAcross>, kDotsDown> kBits{
    {{0x01, 0x08}, {0x02, 0x10}, {0x04, 0x20}, {0x40, 0x80}}};
/// East first, then to the left.
constexpr std::array<const char*, 8> kArrows{"→", "↗", "↑", "↖", "←", "↙", "↓", "↘"};

/// Index of a cell in a map of `rows` rows and twice as many columns.
std::size_t place(int rows, int row, int column) {
  return 2 * static_cast<std::size_t>(rows) * static_cast<std::size_t>(row) +
         static_cast<std::size_t>(column);
}

/// U+2800 + dots in UTF-8.
std::string braille(std::uint8_t dots) {
  return {'\xe2', static_cast<char>(0xa0 | (dots >> 6U)), static_cast<char>(0x80 | (dots & 0x3fU))};
}

}  // namespace

BrailleMap::BrailleMap(int rows, double half_extent_m)
    : rows_(rows), half_extent_m_(half_extent_m), cells_(place(rows, rows, 0)) {}

void BrailleMap::dot(double x_m, double y_m, bool bright) {
  const int size = rows_ * kDotsDown;
  const double scale = size / (2.0 * half_extent_m_);
  const double across = std::floor((x_m + half_extent_m_) * scale);
  const double down = std::floor((half_extent_m_ - y_m) * scale);
  if (!(across >= 0.0 && across < size && down >= 0.0 && down < size)) return;
  const int column = static_cast<int>(across), row = static_cast<int>(down);
  Cell& cell = cells_[place(rows_, row / kDotsDown, column / kDotsAcross)];
  cell.dots |= kBits[static_cast<std::size_t>(row % kDotsDown)]
                    [static_cast<std::size_t>(column % kDotsAcross)];
  cell.bright = cell.bright || bright;
}

void BrailleMap::arrow(double x_m, double y_m, double yaw_rad) {
  if (!std::isfinite(x_m) || !std::isfinite(y_m) || !std::isfinite(yaw_rad)) return;
  const double cell_m = 2.0 * half_extent_m_ / rows_;  // its height
  const auto index = [&](double from_edge_m, double size_m, int count) {
    return std::clamp(static_cast<int>(std::clamp(from_edge_m / size_m, 0.0, 1e6)), 0, count - 1);
  };
  const int row = index(half_extent_m_ - y_m, cell_m, rows_);
  const int column = index(x_m + half_extent_m_, cell_m / 2.0, 2 * rows_);
  const auto eighth =
      std::lround(std::remainder(yaw_rad, 2.0 * std::numbers::pi) / (std::numbers::pi / 4.0));
  cells_[place(rows_, row, column)].symbol = kArrows[static_cast<std::size_t>((eighth + 8) % 8)];
}

std::vector<std::string> BrailleMap::lines() const {
  std::vector<std::string> all;
  for (int row = 0; row < rows_; ++row) {
    std::string line;
    for (int column = 0; column < 2 * rows_; ++column) {
      const Cell& cell = cells_[place(rows_, row, column)];
      if (cell.symbol != nullptr) {
        line += std::string("\033[1m") + cell.symbol + "\033[0m";
      } else if (cell.dots == 0) {
        line += ' ';
      } else {
        line += cell.bright ? braille(cell.dots) : "\033[2m" + braille(cell.dots) + "\033[0m";
      }
    }
    all.push_back(line);
  }
  return all;
}

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

namespace {

/// Columns and rows; 0 where the terminal does not say.
winsize size_of_terminal() {
  winsize size{};
  ioctl(STDERR_FILENO, TIOCGWINSZ, &size);
  return size;
}

/// Longest beginning that fits into a row, up to a blank: half a number is a wrong one.
std::string cut_to_terminal(const std::string& line) {
  const std::size_t columns = size_of_terminal().ws_col;
  const bool has_escapes = line.find('\033') != std::string::npos;  // from who asked has_room()
  if (columns == 0 || has_escapes) return line;
  std::size_t shown = 0;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const bool begins = (static_cast<unsigned char>(line[i]) & 0xc0U) != 0x80U;  // in UTF-8
    if (begins && ++shown > columns) return line.substr(0, line.find_last_of(' ', i));
  }
  return line;
}

}  // namespace

TerminalStatus::TerminalStatus(bool wanted) : shown_(wanted && isatty(STDERR_FILENO) != 0) {}

bool TerminalStatus::has_room(int columns, int rows) const {
  const winsize size = size_of_terminal();
  return shown_ && size.ws_col >= columns && size.ws_row > rows;
}

std::string TerminalStatus::erasure() const {
  if (!shown_) return "";
  const std::string up = lines_.size() > 1 ? fmt::format("\033[{}A", lines_.size() - 1) : "";
  return "\r" + up + (lines_.size() > 1 ? "\033[J" : "\033[K");  // to the end: of all, of the line
}

std::string TerminalStatus::rewritten(std::size_t before, const std::vector<std::string>& lines) {
  const std::string up = before > 1 ? fmt::format("\033[{}A", before - 1) : "";
  return fmt::format("\r{}{}\033[J", up, fmt::join(lines, "\033[K\n"));
}

void TerminalStatus::show(const std::vector<std::string>& lines) {
  if (!shown_) return;
  const std::size_t before = lines_.size();
  lines_ = lines;
  for (std::string& line : lines_) line = cut_to_terminal(line);
  fmt::print(stderr, "{}", rewritten(before, lines_));
  std::fflush(stderr);
}

void TerminalStatus::say(const std::string& line) {
  fmt::print(stderr, "{}{}\n", erasure(), line);
  const std::vector<std::string> status = std::move(lines_);
  lines_.clear();
  if (!status.empty()) show(status);
}

void TerminalStatus::clear() {
  if (!shown_) return;
  fmt::print(stderr, "{}", erasure());
  lines_.clear();
  std::fflush(stderr);
}

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
