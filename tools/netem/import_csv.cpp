#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <chrono>
#include <cmath>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "common/base/csv_table.hpp"
#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "tools/netem/import.hpp"

namespace tether {
namespace {

constexpr std::string_view kForm = "0000-00-00T00:00:00";  // a digit for each 0

bool has_form(std::string_view text, std::string_view form) {
  if (text.size() != form.size()) return false;
  for (std::size_t i = 0; i < form.size(); ++i) {
    const bool is_digit = text[i] >= '0' && text[i] <= '9';
    const bool is_blank = form[i] == 'T' && text[i] == ' ';
    if (form[i] == '0' ? !is_digit : text[i] != form[i] && !is_blank) return false;
  }
  return true;
}

/// Ahead of UTC.
std::optional<int> zone_s(std::string_view zone) {
  if (zone.empty() || zone == "Z") return 0;
  const std::string_view shift = zone.substr(1);
  const bool is_signed = zone.front() == '+' || zone.front() == '-';
  if (!is_signed || !(has_form(shift, "00:00") || has_form(shift, "0000") || has_form(shift, "00")))
    return std::nullopt;
  const int hours = *to_number<int>(shift.substr(0, 2));
  const int minutes = shift.size() > 2 ? *to_number<int>(shift.substr(shift.size() - 2)) : 0;
  return (zone.front() == '-' ? -60 : 60) * (60 * hours + minutes);
}

/// A time in ISO 8601, as seconds since 1970, to the nanosecond: 2026-11-26T15:04:05, with a blank
/// for the T, with decimals behind a point or a comma, and with a zone: Z, +01:00, +0100 or +01;
/// without one it is UTC. Nothing if it is not such a time.
std::optional<long double> from_iso_time(std::string_view text) {
  if (!has_form(text.substr(0, kForm.size()), kForm)) return std::nullopt;
  const auto number = [&](std::size_t at, std::size_t digits = 2) {
    return *to_number<unsigned>(text.substr(at, digits));
  };
  const std::chrono::year_month_day date{std::chrono::year(static_cast<int>(number(0, 4))),
                                         std::chrono::month(number(5)),
                                         std::chrono::day(number(8))};
  if (!date.ok() || number(11) > 23 || number(14) > 59 || number(17) > 60) return std::nullopt;
  std::string_view rest = text.substr(kForm.size());
  std::string decimals = "0.";
  if (rest.starts_with('.') || rest.starts_with(',')) {
    const std::string_view digits = rest.substr(1, rest.find_first_not_of("0123456789", 1) - 1);
    if (digits.empty()) return std::nullopt;
    decimals += digits;
    rest.remove_prefix(1 + digits.size());
  }
  const auto shift_s = zone_s(rest);
  if (!shift_s) return std::nullopt;
  const auto days = std::chrono::sys_days(date).time_since_epoch().count();
  return days * 86400.0L + number(11) * 3600 + number(14) * 60 + number(17) - *shift_s +
         *to_number<long double>(decimals);
}

using Units = std::vector<std::pair<std::string, double>>;  // and what one is worth
const std::string kIso = "iso";
const Units kTimes{{"ns", 1e-9}, {"us", 1e-6}, {"µs", 1e-6}, {"ms", 1e-3}, {"s", 1.0}, {kIso, 1.0}};
const std::vector<std::string> kLosses{"lost", "share", "percent", "prr", "prr_percent"};

struct Kind {
  std::string what;                ///< name of the option
  std::vector<std::string> stems;  ///< beginnings of the names of such columns
  std::vector<std::string> units;
};

const Kind& kind(const std::string& what) {
  static const std::array<Kind, 3> kKinds{
      {{"time", {"time", "timestamp", "ts", "t", "epoch"}, {"ns", "us", "µs", "ms", "s", kIso}},
       {"delay",
        {"delay", "latency", "owd", "delay_one_way", "one_way_delay", "rtt", "ping"},
        {"ns", "us", "µs", "ms", "s"}},
       {"loss", {"lost", "loss", "prr"}, kLosses}}};
  return *std::find_if(kKinds.begin(), kKinds.end(), [&](const Kind& k) { return k.what == what; });
}

struct Column {
  std::string name;  ///< empty: there is none
  std::string unit;
  std::string stem;
};

/// "RTT (ms)" is "rtt" and "ms"; so is "delay_ms"; "delay, one way (ms)" is "delay_one_way" and
/// "ms"; a name without a unit at its end has "".
std::pair<std::string, std::string> stem_and_unit(const std::string& name,
                                                  const std::vector<std::string>& units) {
  std::string words;
  for (const char c : name) {
    const bool parts = std::string_view(" ([-.,_").find(c) != std::string_view::npos;
    if (c == '%') words += "percent";
    if (c == ')' || c == ']' || c == '%' || (parts && words.ends_with('_'))) continue;
    words += parts ? '_' : static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  }
  for (const std::string& unit : units) {
    const std::string end = "_" + unit;
    if (!words.ends_with(end)) continue;
    return {words.substr(0, words.size() - end.size()), unit};
  }
  return {words, ""};
}

[[noreturn]] void refuse_unit(const CsvTable& table, const Kind& k, const std::string& column) {
  table.fail(fmt::format("column \"{}\" needs its unit: --{} \"{}:UNIT\", one of {}",
                         printable(column, kLongestNameShown), k.what,
                         printable(column, kLongestNameShown), fmt::join(k.units, ", ")));
}

/// The column that an option names, or whose name is of the kind.
Column column_of(const CsvTable& table, const Kind& k, const std::string& option) {
  const auto has_unit = [&](const std::string& unit) {
    return std::find(k.units.begin(), k.units.end(), unit) != k.units.end();
  };
  const auto with_unit = [&](Column column) {
    if (column.unit.empty() && (column.stem == "lost" || column.stem == "prr") &&
        k.what == "loss") {
      column.unit = column.stem;
    } else if (column.stem == "prr" && column.unit == "percent") {
      column.unit = "prr_percent";
    }
    if (column.unit.empty() && k.what == "time") column.unit = kIso;
    if (column.unit.empty()) refuse_unit(table, k, column.name);
    return column;
  };
  if (!option.empty()) {
    const std::size_t colon = option.rfind(':');
    const bool is_said = colon != std::string::npos && has_unit(option.substr(colon + 1));
    const std::string name = is_said ? option.substr(0, colon) : option;
    if (!table.has(name)) {
      if (colon != std::string::npos && table.has(option.substr(0, colon))) {
        table.fail(fmt::format("--{} \"{}\": the unit must be one of {}", k.what,
                               printable(option, kLongestNameShown), fmt::join(k.units, ", ")));
      }
      table.fail(fmt::format("has no column \"{}\" (--{}), but {}; units are {}",
                             printable(name, kLongestNameShown), k.what,
                             fmt::join(table.columns(), ", "), fmt::join(k.units, ", ")));
    }
    const auto [stem, unit] = stem_and_unit(name, k.units);
    return with_unit({name, is_said ? option.substr(colon + 1) : unit, stem});
  }
  std::vector<Column> found;
  for (const std::string& name : table.columns()) {
    const auto [stem, unit] = stem_and_unit(name, k.units);
    if (std::find(k.stems.begin(), k.stems.end(), stem) != k.stems.end()) {
      found.push_back({name, unit, stem});
    }
  }
  if (found.size() > 1) {
    table.fail(
        fmt::format("\"{}\" or \"{}\"? Say which with --{}", found[0].name, found[1].name, k.what));
  }
  return found.empty() ? Column{} : with_unit(found.front());
}

double worth(const std::string& unit) {
  return std::find_if(kTimes.begin(), kTimes.end(), [&](const auto& u) { return u.first == unit; })
      ->second;
}

/// In the column's unit. Epochs in nanoseconds have more digits than a double.
long double time_of(const CsvTable& table, const Column& column) {
  const std::string_view cell = table.cell(column.name);
  if (column.unit == kIso) {
    if (const auto time_s = from_iso_time(cell)) return *time_s;
    const std::string name = printable(column.name, kLongestNameShown);
    table.refuse(
        column.name,
        fmt::format("like 2026-11-26T15:04:05.123Z, with a blank for the T, another zone "
                    "(+01:00) or none; a number needs its unit: --time \"{}:UNIT\", one of "
                    "{}",
                    name, fmt::join(kind("delay").units, ", ")));
  }
  const auto value = to_number<long double>(cell);
  if (!value || !std::isfinite(*value)) {
    table.refuse(column.name,
                 fmt::format("a number of {}, or of the unit \"{}\"", column.unit, kIso));
  }
  return *value;
}

double prr_of(const CsvTable& table, const Column& column) {
  const std::string_view cell = table.cell(column.name);
  if (cell.empty()) table.refuse(column.name, "a value: leave out rows whose losses are not known");
  if (column.unit == "lost") {
    if (cell == "0" || cell == "false" || cell == "no") return 1.0;
    if (cell == "1" || cell == "true" || cell == "yes") return 0.0;
    table.refuse(column.name, "0 or 1, false or true, no or yes");
  }
  const double most = column.unit.ends_with("percent") ? 100.0 : 1.0;
  const double value = table.number(column.name);
  if (value < 0.0 || value > most) table.refuse(column.name, fmt::format("in [0, {:g}]", most));
  return column.unit.starts_with("prr") ? value / most : 1.0 - value / most;
}

struct CsvColumns {
  Column time, delay, loss;
  double delay_factor = 1.0;  ///< to milliseconds one way
};

Imported::Row row_of(const CsvTable& table, const CsvColumns& columns, double time_s) {
  Imported::Row row{.time_s = time_s};
  if (!columns.loss.name.empty()) row.prr = prr_of(table, columns.loss);
  if (columns.delay.name.empty()) return row;
  const std::string_view cell = table.cell(columns.delay.name);
  if (cell.empty() || cell == "nan" || cell == "NaN") {
    if (columns.loss.name.empty()) row.prr = 0.0;
    if (row.prr > 0.0) table.refuse(columns.delay.name, "a number where not all is lost");
    return row;
  }
  row.delay_ms = table.number(columns.delay.name) * columns.delay_factor;
  if (*row.delay_ms < 0.0) table.refuse(columns.delay.name, "0 or more");
  return row;
}

}  // namespace

Imported import_csv(std::istream& in, const std::string& name, const ImportColumns& options) {
  CsvTable table(in, name);
  CsvColumns columns{column_of(table, kind("time"), options.time),
                     column_of(table, kind("delay"), options.delay),
                     column_of(table, kind("loss"), options.loss)};
  if (columns.time.name.empty()) table.fail("no column is a time: name it with --time NAME:UNIT");
  if (columns.delay.name.empty() && columns.loss.name.empty()) {
    table.fail("neither delays nor losses: name their columns with --delay and --loss NAME:UNIT");
  }
  Imported imported;
  imported.has_delays = !columns.delay.name.empty();
  imported.of_fates = columns.loss.unit == "lost" || columns.loss.name.empty();
  if (imported.has_delays) {
    const bool halved =
        options.round_trip || columns.delay.stem == "rtt" || columns.delay.stem == "ping";
    columns.delay_factor = worth(columns.delay.unit) * 1e3 * (halved ? 0.5 : 1.0);
    if (halved) imported.notes.push_back("delays are half the round trips");
  }
  long double first = 0.0L;
  std::size_t doubles = 0;
  while (table.next_row()) {
    const long double time = time_of(table, columns.time);
    if (imported.rows.empty()) first = time;
    const double time_s =
        std::round(static_cast<double>((time - first) * worth(columns.time.unit)) * 1e9) / 1e9;
    if (!imported.rows.empty() && time_s < imported.rows.back().time_s) {
      table.refuse(columns.time.name, "after that of the row before");
    }
    if (!imported.rows.empty() && time_s == imported.rows.back().time_s) {
      imported.rows.pop_back();
      ++doubles;
    }
    imported.rows.push_back(row_of(table, columns, time_s));
  }
  if (imported.rows.empty()) throw UsageError(name + ": no rows");
  if (doubles > 0) {
    imported.notes.push_back(
        fmt::format("of rows of one instant the last counts: {} left out", doubles));
  }
  return imported;
}

}  // namespace tether
