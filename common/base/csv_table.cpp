#include "common/base/csv_table.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"

namespace tether {
namespace {

std::string_view unquoted(std::string_view cell) {
  const bool quoted = cell.size() >= 2 && cell.front() == '"' && cell.back() == '"';
  return quoted ? trimmed(cell.substr(1, cell.size() - 2)) : cell;
}

/// Where the first cell ends: npos if it is the last.
std::size_t end_of_cell(std::string_view line, char delimiter) {
  const auto quote = line.find_first_not_of(' ');
  std::size_t from = 0;
  if (quote != std::string_view::npos && line[quote] == '"') from = line.find('"', quote + 1);
  return line.find(delimiter, from == std::string_view::npos ? 0 : from);
}

std::vector<std::string_view> split(std::string_view line, char delimiter) {
  std::vector<std::string_view> cells;
  for (;;) {
    const auto end = end_of_cell(line, delimiter);
    cells.push_back(unquoted(trimmed(line.substr(0, end))));
    if (end == std::string_view::npos) return cells;
    line.remove_prefix(end + 1);
  }
}

/// The one that the header has.
char delimiter_of(std::string_view header) {
  for (const char delimiter : {',', ';', '\t'}) {
    if (split(header, delimiter).size() > 1) return delimiter;
  }
  return ',';
}

}  // namespace

double finite_number(std::string_view text) {
  const auto value = to_number<double>(text);
  return value && std::isfinite(*value) ? *value : std::numeric_limits<double>::quiet_NaN();
}

CsvTable::CsvTable(std::istream& in, std::string name) : in_(in), name_(std::move(name)) {
  if (!next_line()) fail("no header line");
  delimiter_ = delimiter_of(line_);
  for (std::string_view cell : split(line_, delimiter_)) {
    if (!columns_.emplace(cell, width_).second)
      fail(fmt::format("two columns \"{}\"", printable(cell, kLongestValueShown)));
    ++width_;
  }
}

bool CsvTable::next_line() {
  while (std::getline(in_, line_)) {
    constexpr std::string_view kByteOrderMark = "\xef\xbb\xbf";
    if (++line_number_ == 1 && line_.starts_with(kByteOrderMark)) {
      line_.erase(0, kByteOrderMark.size());
    }
    const std::string_view content = trimmed(line_);
    if (!content.empty() && content.front() != '#') return true;
  }
  return false;
}

std::vector<std::string> CsvTable::columns() const {
  std::vector<std::string> names;
  for (const auto& [name, place] : columns_) names.push_back(name);
  return names;
}

bool CsvTable::next_row() {
  if (!next_line()) return false;
  row_ = split(line_, delimiter_);
  if (row_.size() != width_) {
    fail(fmt::format("{} cells, but the header has {}", row_.size(), width_));
  }
  return true;
}

double CsvTable::number(const std::string& column) const {
  const double value = finite_number(cell(column));
  if (std::isnan(value)) refuse(column, "a finite number");
  return value;
}

std::int64_t CsvTable::whole_number(const std::string& column) const {
  const auto value = to_number<std::int64_t>(cell(column));
  if (!value) refuse(column, "a whole number");
  return *value;
}

void CsvTable::refuse(const std::string& column, const std::string& allowed) const {
  fail(fmt::format("{} = \"{}\" must be {}", column, printable(cell(column), kLongestValueShown),
                   allowed));
}

void CsvTable::fail(const std::string& reason) const {
  throw UsageError(fmt::format("{}:{}: {}", name_, std::max(1, line_number_), reason));
}

}  // namespace tether
