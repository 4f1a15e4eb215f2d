#include "tools/experiment/report/tables.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>

#include "tools/experiment/figures/figure_script.hpp"
#include "tools/experiment/report/figure.hpp"

namespace tether {
namespace {

using Labels = std::vector<std::string>;  // values of some keys
using Places = std::vector<Labels>;       // each once, as the file has them

/// The arms of a table and the keys that tell them apart.
struct Chosen {
  std::vector<std::size_t> arms;
  std::vector<std::string> keys;
};

Chosen chosen_by(const SweepData& data, const TableChoice& choice) {
  Chosen chosen;
  for (std::size_t arm = 0; arm < data.arms().size(); ++arm) {
    if (is_selected(choice.where, data.arms()[arm].settings)) chosen.arms.push_back(arm);
  }
  for (const KeyValue& setting : data.arms().front().settings) {
    const std::string first = data.text(chosen.arms.at(0), setting.key);
    const bool varies = std::any_of(chosen.arms.begin(), chosen.arms.end(), [&](std::size_t arm) {
      return data.text(arm, setting.key) != first;
    });
    if (varies) chosen.keys.push_back(setting.key);
  }
  return chosen;
}

std::vector<std::string> without(const std::vector<std::string>& keys,
                                 const std::vector<std::string>& others) {
  std::vector<std::string> rest;
  for (const std::string& key : keys) {
    if (std::find(others.begin(), others.end(), key) == others.end()) rest.push_back(key);
  }
  return rest;
}

Labels labels_of(const SweepData& data, std::size_t arm, const std::vector<std::string>& keys) {
  Labels labels;
  for (const std::string& key : keys) labels.push_back(data.text(arm, key));
  return labels;
}

Places places_of(const SweepData& data, const Chosen& chosen,
                 const std::vector<std::string>& keys) {
  Places places;
  for (const std::size_t arm : chosen.arms) {
    Labels labels = labels_of(data, arm, keys);
    if (std::find(places.begin(), places.end(), labels) == places.end()) places.push_back(labels);
  }
  return places;
}

std::vector<std::string> heads_of(const std::vector<std::string>& keys) {
  std::vector<std::string> heads;
  for (const std::string& key : keys) heads.push_back(label_of_key(key));
  return heads;
}

std::string digits_of(double value) {
  return std::isfinite(value) ? fmt::format("{:.3g}", value) : "-";
}

std::string cell_of(double value, const Interval& interval) {
  if (!std::isfinite(interval.low)) return digits_of(value);
  return fmt::format("{} [{}, {}]", digits_of(value), digits_of(interval.low),
                     digits_of(interval.high));
}

/// Text of a cell; the mean of survivors where there is no single mean.
std::string cell_of(const SweepData::ArmData& arm) {
  const Summary& s = arm.has_two_humps ? arm.survival.survivors : arm.summary;
  const std::string mean = cell_of(s.mean, s.mean_interval);
  return arm.has_two_humps ? mean + ", lost " + share_text(arm.survival.lost) : mean;
}

/// "3 of 60 vehicles were lost", if some mean is of two humps; else nothing.
std::string humps_note(const SweepData& data, const std::vector<std::size_t>& arms) {
  bool has_two_humps = false;
  std::size_t lost = 0, n = 0;
  for (const std::size_t number : arms) {
    const SweepData::ArmData& arm = data.arms()[number];
    has_two_humps = has_two_humps || arm.has_two_humps;
    lost += arm.survival.lost.count;
    n += arm.survival.lost.n;
  }
  return has_two_humps ? fmt::format("{} of {} vehicles were lost", lost, n) : "";
}

/// Warning for tables whose means are of all runs.
std::string means_warning(const SweepData& data, const std::vector<std::size_t>& arms) {
  const std::string humps = humps_note(data, arms);
  return humps.empty() ? "" : fmt::format("; {}, which the means include", humps);
}

std::string cell_of(const Summary& s) { return cell_of(s.mean, s.mean_interval); }

std::string csv_numbers(const std::vector<double>& values) {
  std::string cells;
  for (const double value : values) {
    cells += std::isfinite(value) ? fmt::format(",{:.6g}", value) : ",";
  }
  return cells;
}

/// Survivors' mean and the share of lost vehicles, each with its interval.
std::string survival_csv(const Survival& s) {
  const Interval &survivors = s.survivors.mean_interval, &lost = s.lost.interval;
  return csv_numbers(
      {s.survivors.mean, survivors.low, survivors.high, s.lost.value, lost.low, lost.high});
}

std::string csv_labels(const Labels& labels) {
  std::string cells;
  for (const std::string& label : labels) cells += (cells.empty() ? "" : ",") + csv_cell(label);
  return cells;
}

/// "n = 30", or "n = 28 to 30".
std::string n_text(const std::vector<std::size_t>& counts) {
  const auto [least, most] = std::minmax_element(counts.begin(), counts.end());
  return *least == *most ? fmt::format("n = {}", *least)
                         : fmt::format("n = {} to {}", *least, *most);
}

/// Columns' names: "PRR 0.45, delay_ms 100".
std::string column_name(const std::vector<std::string>& keys, const Labels& labels) {
  std::string name;
  for (std::size_t i = 0; i < keys.size(); ++i) {
    name += fmt::format("{}{} {}", i == 0 ? "" : ", ", label_of_key(keys[i]), labels[i]);
  }
  return name;
}

std::optional<std::size_t> arm_at(const SweepData& data, const Chosen& chosen,
                                  const std::vector<std::string>& keys, const Labels& labels) {
  for (const std::size_t arm : chosen.arms) {
    if (labels_of(data, arm, keys) == labels) return arm;
  }
  return std::nullopt;
}

SweepTable titled(const TableChoice& choice, const std::string& note) {
  return {choice.title, note, {}, ""};
}

/// Where the mean passes the limit.
struct Passing {
  std::optional<std::size_t> below, above;  ///< arms: the last before, the first that reaches it
  double at = std::numeric_limits<double>::quiet_NaN();
};

Passing passing_of(const SweepData& data, const TableChoice& choice,
                   const std::vector<std::size_t>& ascending) {
  const auto mean = [&data](std::size_t arm) { return data.arms()[arm].summary.mean; };
  Passing passing;
  for (const std::size_t arm : ascending) {
    if (mean(arm) >= choice.limit) {
      passing.above = arm;
      break;
    }
    passing.below = arm;
  }
  if (passing.below && passing.above) {
    const double from = data.number(*passing.below, choice.key);
    const double to = data.number(*passing.above, choice.key);
    passing.at = from + (to - from) * (choice.limit - mean(*passing.below)) /
                            (mean(*passing.above) - mean(*passing.below));
  }
  return passing;
}

std::string text_of(const Passing& passing, const SweepData& data, const std::string& key) {
  if (!passing.above) return "not up to " + data.text(*passing.below, key);
  if (!passing.below) return "at " + data.text(*passing.above, key) + " already";
  return fmt::format("about {}, between {} and {}", digits_of(passing.at),
                     data.text(*passing.below, key), data.text(*passing.above, key));
}

/// Ratio of two arms: of the vehicles that are lost in neither where a mean of all has two humps,
/// so that it says how far off lost ones ended.
MeanRatio ratio_of(const SweepData::ArmData& over, const SweepData::ArmData& under) {
  const bool has_two_humps = over.has_two_humps || under.has_two_humps;
  return has_two_humps ? mean_ratio(over.survivors, under.survivors, kConfidence, kBootstrapSeed)
                       : mean_ratio(over.runs, under.runs, kConfidence, kBootstrapSeed);
}

std::string cell_of(const Summary& s, const SweepData::ArmData& arm) {
  return arm.has_two_humps ? cell_of(s) + ", lost " + share_text(arm.survival.lost) : cell_of(s);
}

/// Whether the ratio is at least `limit`. Runs without randomness (or a single run) have no
/// interval, only the value; without survivors there is none.
std::string holds(const MeanRatio& r, double limit) {
  if (!std::isfinite(r.ratio)) return "-";
  const double low = std::isfinite(r.interval.low) ? r.interval.low : r.ratio;
  return low >= limit ? "yes" : r.ratio >= limit ? "mean only" : "no";
}

}  // namespace

SweepTable means_table(const SweepData& data, const TableChoice& choice) {
  const Chosen chosen = chosen_by(data, choice);
  const std::vector<std::string> row_keys = without(chosen.keys, choice.columns);
  const std::vector<std::string> column_keys = without(chosen.keys, row_keys);
  const Places columns = places_of(data, chosen, column_keys);
  SweepTable table = titled(choice, "");
  table.rows.push_back(heads_of(row_keys));
  for (const Labels& column : columns) {
    table.rows.front().push_back(column.empty() ? "mean" : column_name(column_keys, column));
  }
  std::vector<std::string> csv_keys = row_keys;
  csv_keys.insert(csv_keys.end(), column_keys.begin(), column_keys.end());
  table.csv = csv_labels(csv_keys) +
              ",mean,low,high,n,failed,survivors_mean,survivors_low,survivors_high,lost,lost_low,"
              "lost_high\n";
  std::vector<std::size_t> counts;
  for (const Labels& row : places_of(data, chosen, row_keys)) {
    table.rows.push_back(row);
    for (const Labels& column : columns) {
      Labels place = row;
      place.insert(place.end(), column.begin(), column.end());
      const auto arm = arm_at(data, chosen, csv_keys, place);
      table.rows.back().push_back(arm ? cell_of(data.arms()[*arm]) : "");
      if (!arm) continue;
      const Summary& s = data.arms()[*arm].summary;
      counts.push_back(s.n);
      table.csv +=
          csv_labels(place) + csv_numbers({s.mean, s.mean_interval.low, s.mean_interval.high}) +
          fmt::format(",{},{}", s.n, s.left_out) + survival_csv(data.arms()[*arm].survival) + "\n";
    }
  }
  table.note = fmt::format("{}: mean [its 95 % interval]; {} runs a cell",
                           label_of_metric(data.metric()), n_text(counts));
  if (const std::string humps = humps_note(data, chosen.arms); !humps.empty()) {
    table.note += fmt::format(
        "; where vehicles were lost, that of the others, and the share of lost ones with its exact "
        "95 % interval: {}",
        humps);
  }
  return table;
}

SweepTable ratio_table(const SweepData& data, const TableChoice& choice) {
  const Chosen chosen = chosen_by(data, choice);
  const std::vector<std::string> row_keys = without(chosen.keys, {choice.key});
  std::vector<std::string> arm_keys = row_keys;
  arm_keys.push_back(choice.key);
  SweepTable table = titled(choice, "");
  table.rows.push_back(heads_of(row_keys));
  for (const std::string& head :
       {choice.over, choice.under, std::string("ratio"), fmt::format("≥ {:g}", choice.limit)}) {
    table.rows.front().push_back(head);
  }
  table.csv = csv_labels(row_keys) + (row_keys.empty() ? "" : ",") +
              "over_mean,over_low,over_high,under_mean,under_low,under_high,ratio,ratio_low,"
              "ratio_high,n,over_lost,under_lost\n";
  std::vector<std::size_t> counts;
  for (const Labels& row : places_of(data, chosen, row_keys)) {
    const auto arm_of = [&](const std::string& value) {
      Labels place = row;
      place.push_back(value);
      return arm_at(data, chosen, arm_keys, place);
    };
    const auto over = arm_of(choice.over), under = arm_of(choice.under);
    if (!over || !under) continue;
    const SweepData::ArmData &first_arm = data.arms()[*over], &second_arm = data.arms()[*under];
    const MeanRatio r = ratio_of(first_arm, second_arm);
    table.rows.push_back(row);
    for (const std::string& cell : {cell_of(r.first, first_arm), cell_of(r.second, second_arm),
                                    cell_of(r.ratio, r.interval), holds(r, choice.limit)}) {
      table.rows.back().push_back(cell);
    }
    counts.push_back(r.first.n);
    const Interval &first = r.first.mean_interval, &second = r.second.mean_interval;
    table.csv += csv_labels(row) +
                 csv_numbers({r.first.mean, first.low, first.high, r.second.mean, second.low,
                              second.high, r.ratio, r.interval.low, r.interval.high})
                     .substr(row.empty() ? 1 : 0) +
                 fmt::format(",{},{},{}\n", r.first.n, first_arm.survival.lost.count,
                             second_arm.survival.lost.count);
  }
  if (counts.empty()) counts.push_back(0);
  table.note = fmt::format(
      "{}: mean [its 95 % interval], and the ratio of the means with that of the bootstrap over "
      "common seeds; {} pairs a row",
      label_of_metric(data.metric()), n_text(counts));
  if (const std::string humps = humps_note(data, chosen.arms); !humps.empty()) {
    table.note += fmt::format(
        "; where vehicles were lost, of the seeds on which neither was, and the share of lost ones "
        "with its exact 95 % interval: {}",
        humps);
  }
  return table;
}

SweepTable limit_table(const SweepData& data, const TableChoice& choice) {
  const Chosen chosen = chosen_by(data, choice);
  const std::vector<std::string> row_keys = without(chosen.keys, {choice.key});
  const std::string metric = label_of_metric(data.metric());
  SweepTable table = titled(choice, "");
  table.rows.push_back(heads_of(row_keys));
  for (const std::string& head : {fmt::format("{} reaches {:g} at", metric, choice.limit),
                                  std::string("mean before"), std::string("mean then")}) {
    table.rows.front().push_back(head);
  }
  table.csv = csv_labels(row_keys) + (row_keys.empty() ? "" : ",") +
              fmt::format("{0}_before,{0}_then,{0}_at,mean_before,mean_then\n", choice.key);
  std::vector<std::size_t> counts;
  for (const Labels& row : places_of(data, chosen, row_keys)) {
    std::vector<std::size_t> arms;
    for (const std::size_t arm : chosen.arms) {
      if (labels_of(data, arm, row_keys) != row) continue;
      arms.push_back(arm);
      counts.push_back(data.arms()[arm].summary.n);
    }
    std::stable_sort(arms.begin(), arms.end(), [&](std::size_t a, std::size_t b) {
      return data.number(a, choice.key) < data.number(b, choice.key);
    });
    const Passing passing = passing_of(data, choice, arms);
    const auto cell = [&data](const std::optional<std::size_t>& arm) {
      return arm ? cell_of(data.arms()[*arm].summary) : std::string("-");
    };
    table.rows.push_back(row);
    for (const std::string& text :
         {text_of(passing, data, choice.key), cell(passing.below), cell(passing.above)}) {
      table.rows.back().push_back(text);
    }
    const auto of = [&](const std::optional<std::size_t>& arm, bool mean) {
      if (!arm) return std::numeric_limits<double>::quiet_NaN();
      return mean ? data.arms()[*arm].summary.mean : data.number(*arm, choice.key);
    };
    table.csv += csv_labels(row) +
                 csv_numbers({of(passing.below, false), of(passing.above, false), passing.at,
                              of(passing.below, true), of(passing.above, true)})
                     .substr(row.empty() ? 1 : 0) +
                 "\n";
  }
  table.note = fmt::format("{}: mean [its 95 % interval]; {} runs a value", metric, n_text(counts));
  table.note += means_warning(data, chosen.arms);
  return table;
}

std::vector<SweepTable> tables_of(const RunStore& store) {
  std::vector<SweepTable> tables;
  std::map<std::string, SweepData> data;
  for (const TableChoice& choice : store.tables()) {
    const auto [of_metric, is_new] = data.try_emplace(choice.metric, store, choice.metric);
    switch (choice.kind) {
      case TableChoice::Kind::means:
        tables.push_back(means_table(of_metric->second, choice));
        break;
      case TableChoice::Kind::ratio:
        tables.push_back(ratio_table(of_metric->second, choice));
        break;
      case TableChoice::Kind::limit:
        tables.push_back(limit_table(of_metric->second, choice));
        break;
    }
  }
  return tables;
}

}  // namespace tether
