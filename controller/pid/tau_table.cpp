#include "controller/pid/tau_table.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <map>
#include <set>
#include <utility>

#include "common/base/csv_table.hpp"
#include "common/base/errors.hpp"

namespace tether {
namespace {

struct Mean {
  double sum = 0.0;
  int count = 0;
};
/// For each PRR and delay: ε by τ.
using Cells = std::map<std::pair<double, double>, std::map<double, Mean>>;

Cells read_cells(std::istream& in, const std::string& name) {
  CsvTable table(in, name);
  for (const char* column : {"channel.prr", "controller.tau_s", "epsilon_m"}) {
    if (table.has(column)) continue;
    throw UsageError(fmt::format(
        "{}: has no column {}; a table of look-aheads needs channel.prr, controller.tau_s and "
        "epsilon_m, and may have channel.delay_ms",
        name, column));
  }
  const bool has_delay = table.has("channel.delay_ms");
  Cells cells;
  while (table.next_row()) {
    const double prr = table.number("channel.prr");
    const double delay_ms = has_delay ? table.number("channel.delay_ms") : 0.0;
    const double tau_s = table.number("controller.tau_s");
    if (prr < 0.0 || prr > 1.0) table.refuse("channel.prr", "in [0, 1]");
    if (delay_ms < 0.0) table.refuse("channel.delay_ms", "0 or more");
    if (tau_s < 0.0 || tau_s > 1e6) table.refuse("controller.tau_s", "in [0, 1e6]");
    if (table.cell("epsilon_m").empty()) continue;
    Mean& mean = cells[{prr, delay_ms}][tau_s];
    mean.sum += table.number("epsilon_m");
    ++mean.count;
  }
  return cells;
}

double best_tau_s(const std::map<double, Mean>& candidates) {
  const auto value = [](const auto& entry) { return entry.second.sum / entry.second.count; };
  return std::min_element(candidates.begin(), candidates.end(),
                          [&](const auto& a, const auto& b) { return value(a) < value(b); })
      ->first;
}

/// Where `x` lies in an ascending list: between [index] and the next, by a share in [0, 1].
std::pair<std::size_t, double> place_in(const std::vector<double>& list, double x) {
  if (list.size() == 1 || x <= list.front()) return {0, 0.0};
  if (x >= list.back()) return {list.size() - 2, 1.0};
  const auto above = std::upper_bound(list.begin(), list.end(), x);
  const auto index = static_cast<std::size_t>(std::distance(list.begin(), above)) - 1;
  return {index, (x - list[index]) / (list[index + 1] - list[index])};
}

}  // namespace

TauTable TauTable::read(std::istream& in, const std::string& name) {
  const Cells cells = read_cells(in, name);
  if (cells.empty()) throw UsageError(fmt::format("{}: has no look-ahead with an error", name));
  std::set<double> prrs, delays;
  for (const auto& [where, unused] : cells) {
    prrs.insert(where.first);
    delays.insert(where.second);
  }
  TauTable table;
  table.prrs_.assign(prrs.begin(), prrs.end());
  table.delays_ms_.assign(delays.begin(), delays.end());
  for (const double prr : table.prrs_) {
    for (const double delay_ms : table.delays_ms_) {
      const auto cell = cells.find({prr, delay_ms});
      if (cell == cells.end()) {
        throw UsageError(
            fmt::format("{}: has nothing for channel.prr = {} and channel.delay_ms = {}: all "
                        "combinations are needed",
                        name, prr, delay_ms));
      }
      table.tau_s_.push_back(best_tau_s(cell->second));
    }
  }
  return table;
}

double TauTable::tau_s(double prr, double delay_ms) const {
  const auto [i, prr_share] = place_in(prrs_, prr);
  const auto [j, delay_share] = place_in(delays_ms_, delay_ms);
  const auto along_delay = [&, j = j, share = delay_share](std::size_t row) {
    return share == 0.0 ? at(row, j) : (1.0 - share) * at(row, j) + share * at(row, j + 1);
  };
  const double low = along_delay(i);
  return prr_share == 0.0 ? low : (1.0 - prr_share) * low + prr_share * along_delay(i + 1);
}

}  // namespace tether
