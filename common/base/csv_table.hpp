#pragma once

#include <cstddef>
#include <cstdint>
#include <istream>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace tether {

/// A CSV file with a header line, read row by row. Commas separate cells; if the header has none,
/// semicolons, else tabs; not in a cell between quotes. Blanks around a cell, then double quotes
/// around it, and a byte order mark are ignored. Empty lines and lines that begin with '#' do not
/// count. Every error is a UsageError that begins "name:line: ".
class CsvTable {
 public:
  /// Reads the header; `name` stands for the file in messages. Throws if there is none, or if it
  /// names a column twice.
  CsvTable(std::istream& in, std::string name);

  bool has(const std::string& column) const { return columns_.count(column) > 0; }
  /// The names of the header, in the order of the alphabet.
  std::vector<std::string> columns() const;
  /// Moves to the next row; false at the end. Throws if it is not as wide as the header.
  bool next_row();

  /// The line of the present row, from 1; before the first row, that of the header.
  int line_number() const { return line_number_; }

  // Cells of the present row; the header must have `column`. number() throws if the cell is not a
  // number.
  std::string_view cell(const std::string& column) const { return row_[columns_.at(column)]; }
  double number(const std::string& column) const;  ///< finite
  std::int64_t whole_number(const std::string& column) const;

  /// Throws "name:line: column = "cell" must be allowed".
  [[noreturn]] void refuse(const std::string& column, const std::string& allowed) const;
  /// Throws "name:line: reason".
  [[noreturn]] void fail(const std::string& reason) const;

 private:
  bool next_line();

  std::istream& in_;
  std::string name_;
  std::string line_;
  char delimiter_ = ',';
  int line_number_ = 0;
  std::map<std::string, std::size_t> columns_;
  std::size_t width_ = 0;
  std::vector<std::string_view> row_;  // into line_
};

/// `text` as a finite number, all of it; otherwise NaN.
double finite_number(std::string_view text);

}  // namespace tether
