#include "netem/playback/position_map.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <sstream>
#include <utility>

#include "common/base/csv_table.hpp"
#include "common/base/errors.hpp"
#include "common/base/file_store.hpp"
#include "common/base/input_file.hpp"
#include "common/base/text.hpp"

namespace tether {
namespace {

/// Words of a file, with the line that each is in.
class Words {
 public:
  Words(std::istream& in, std::string name) : in_(in), name_(std::move(name)) {}

  /// Empty at the end.
  std::string next() {
    std::string word;
    while (!(line_ >> word)) {
      std::string text;
      if (!std::getline(in_, text)) return {};
      ++line_number_;
      line_ = std::istringstream(text);
    }
    return word;
  }
  double number(const std::string& what) {
    const std::string word = next();
    const double value = finite_number(word);
    if (!std::isnan(value)) return value;
    fail(word.empty() ? fmt::format("ends before {}", what)
                      : fmt::format("{} = \"{}\" must be a finite number", what,
                                    printable(word, kLongestValueShown)));
  }
  [[noreturn]] void fail(const std::string& reason) const {
    throw UsageError(fmt::format("{}:{}: {}", name_, line_number_, reason));
  }

 private:
  std::istream& in_;
  std::string name_;
  std::istringstream line_;
  int line_number_ = 0;
};

std::string lower_case(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

struct Header {
  std::map<std::string, double> values;
  double first_number = 0.0;  // first coordinate of the grid
};

Header read_header(Words& words) {
  const std::string kKeys[] = {"ncols",     "nrows",     "xllcorner", "yllcorner",
                               "xllcenter", "yllcenter", "cellsize",  "nodata_value"};
  Header header;
  for (;;) {
    const std::string word = words.next(), key = lower_case(word);
    if (word.empty()) words.fail("ends before the grid");
    if (std::find(std::begin(kKeys), std::end(kKeys), key) != std::end(kKeys)) {
      header.values[key] = words.number(key);
      continue;
    }
    header.first_number = finite_number(word);
    if (std::isnan(header.first_number)) {
      words.fail(
          fmt::format("\"{}\" is neither a number nor a header key (ncols, nrows, xllcorner, "
                      "yllcorner, xllcenter, yllcenter, cellsize, NODATA_value)",
                      word));
    }
    return header;
  }
}

std::size_t read_count(const Header& header, const std::string& key, const Words& words) {
  constexpr double kMost = 10'000.0;
  const auto found = header.values.find(key);
  if (found == header.values.end()) words.fail("the header has no " + key);
  const double count = found->second;
  if (count < 1.0 || count > kMost || count != std::floor(count)) {
    words.fail(fmt::format("{} = {} must be a whole number from 1 to {}", key, count, kMost));
  }
  return static_cast<std::size_t>(count);
}

/// The centre of the first cell along one axis.
double read_centre(const Header& header, const std::string& axis, double cell_size_m,
                   const Words& words) {
  const auto corner = header.values.find(axis + "llcorner");
  const auto centre = header.values.find(axis + "llcenter");
  if ((corner == header.values.end()) == (centre == header.values.end())) {
    words.fail(fmt::format("the header needs one of {0}llcorner and {0}llcenter", axis));
  }
  return centre != header.values.end() ? centre->second : corner->second + 0.5 * cell_size_m;
}

}  // namespace

PositionMap PositionMap::read(std::istream& in, const std::string& name) {
  Words words(in, name);
  const Header header = read_header(words);
  PositionMap map;
  map.columns_ = read_count(header, "ncols", words);
  map.rows_ = read_count(header, "nrows", words);
  const auto size = header.values.find("cellsize");
  if (size == header.values.end() || !(size->second > 0.0)) {
    words.fail("the header needs a cellsize above 0");
  }
  map.cell_size_m_ = size->second;
  map.x_m_ = read_centre(header, "x", map.cell_size_m_, words);
  map.y_m_ = read_centre(header, "y", map.cell_size_m_, words);
  const auto no_data = header.values.find("nodata_value");
  const std::size_t cells = map.columns_ * map.rows_;
  while (map.values_.size() < cells) {
    const double value =
        map.values_.empty()
            ? header.first_number
            : words.number(fmt::format("cell {} of {}", map.values_.size() + 1, cells));
    if (no_data != header.values.end() && value == no_data->second) {
      words.fail("a cell without data: give it an SNR, such as -100 where nothing is received");
    }
    map.values_.push_back(value);
  }
  if (const std::string word = words.next(); !word.empty()) {
    words.fail(fmt::format("\"{}\" comes after the last of the {} cells",
                           printable(word, kLongestValueShown), cells));
  }
  return map;
}

PositionMap PositionMap::load(const std::string& file) {
  std::ifstream in = open_input(file, "the map", kMostTableBytes);
  return read(in, file);
}

std::shared_ptr<const PositionMap> PositionMap::kept(const std::string& file) {
  static FileStore<PositionMap> store(load);
  return store.get(file);
}

double PositionMap::cell(std::size_t column, std::size_t row_from_below) const {
  return values_[(rows_ - 1 - row_from_below) * columns_ + column];
}

double PositionMap::at(double x_m, double y_m) const {
  const auto place = [](double position, double first, double size, std::size_t cells) {
    const double index = std::clamp((position - first) / size, 0.0, static_cast<double>(cells - 1));
    const auto below = std::min(static_cast<std::size_t>(index), cells >= 2 ? cells - 2 : 0);
    return std::pair(below, index - static_cast<double>(below));
  };
  const auto [i, u] = place(x_m, x_m_, cell_size_m_, columns_);
  const auto [j, v] = place(y_m, y_m_, cell_size_m_, rows_);
  const std::size_t right = std::min(i + 1, columns_ - 1), above = std::min(j + 1, rows_ - 1);
  return (1.0 - v) * ((1.0 - u) * cell(i, j) + u * cell(right, j)) +
         v * ((1.0 - u) * cell(i, above) + u * cell(right, above));
}

Curve::Curve(const std::vector<std::vector<double>>& points, double low, double high,
             const std::string& key)
    : points_(points) {
  double before = -std::numeric_limits<double>::infinity();
  for (const auto& point : points_) {
    if (point.size() != 2) throw UsageError(key + " must be a list of pairs [x, y]");
    if (!(point[0] > before)) {
      throw UsageError(fmt::format("{}: {} must be above the point's before", key, point[0]));
    }
    if (!(point[1] >= low && point[1] <= high)) {
      throw UsageError(fmt::format("{}: {} must be in [{}, {}]", key, point[1], low, high));
    }
    before = point[0];
  }
  if (points_.size() < 2) throw UsageError(key + " needs two points or more");
}

double Curve::at(double x) const {
  if (x <= points_.front()[0]) return points_.front()[1];
  if (x >= points_.back()[0]) return points_.back()[1];
  const auto next = std::upper_bound(points_.begin(), points_.end(), x,
                                     [](double value, const auto& p) { return value < p[0]; });
  const auto& a = *(next - 1);
  const auto& b = *next;
  return a[1] + (x - a[0]) / (b[0] - a[0]) * (b[1] - a[1]);
}

}  // namespace tether
