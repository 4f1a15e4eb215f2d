#pragma once

#include <cstddef>
#include <cstdint>
#include <istream>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace tether {

/// A CSV file with a header line, row by row: cells between commas, blanks around them and double
/// quotes around those ignored (a comma between quotes separates all the same), as is a byte order
/// mark. Empty lines and lines that begin with '#' do not count. Every error is a UsageError that
/// begins "name:line: ".
class CsvTable {
 public:
  /// Reads the header; `name` stands for the file in messages. Throws if there is none, or if it
  /// names a column twice.
  CsvTable(std::istream& in, std::string name);

  bool has(const std::string& column) const { return columns_.count(column) > 0; }
  /// Moves to the next row; false at the end. Throws if it is not as wide as the header.
  bool next_row();

  /// Of the present row, or of the header before the first; from 1.
  int line_number() const { return line_number_; }

  // Of the present row; the header has `column`. The numbers throw if the cell is none.
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
  int line_number_ = 0;
  std::map<std::string, std::size_t> columns_;
  std::size_t width_ = 0;
  std::vector<std::string_view> row_;  // into line_
};

/// `text` as a finite number, all of it; NaN if it is none.
double finite_number(std::string_view text);

}  // namespace tether
