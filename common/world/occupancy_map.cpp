#include "common/world/occupancy_map.hpp"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/errors.hpp"
#include "common/base/input_file.hpp"
#include "common/base/text.hpp"

namespace tether {
namespace {

/// A grey image.
struct Pgm {
  std::size_t columns = 0;
  std::size_t rows = 0;
  std::uint32_t white = 255;          ///< a pixel's largest value, 1 … 65535
  std::vector<std::uint16_t> pixels;  ///< row after row, the upper one first
};

constexpr std::uint32_t kMostPixelsASide = 50'000;
constexpr std::uint32_t kWhitest = 65'535;

class PgmReader {
 public:
  PgmReader(std::string file, std::string_view bytes) : file_(std::move(file)), rest_(bytes) {}

  Pgm read() {
    const std::string_view magic = rest_.substr(0, 2);
    if (magic != "P2" && magic != "P5") {
      refuse(fmt::format("begins with \"{}\": must be a PGM image, P2 or P5", printable(magic)));
    }
    rest_.remove_prefix(2);
    Pgm pgm;
    pgm.columns = number("the width", 1, kMostPixelsASide);
    pgm.rows = number("the height", 1, kMostPixelsASide);
    pgm.white = number("the largest value", 1, kWhitest);
    const std::size_t count = pgm.columns * pgm.rows;
    if (magic == "P2") {
      // Each takes a digit and a blank: what cannot be there gets no memory.
      if (rest_.size() < count) truncated(count);
      pgm.pixels.reserve(count);
      for (std::size_t i = 0; i < count; ++i) {
        skip_blanks();
        if (rest_.empty()) truncated(count);
        pgm.pixels.push_back(static_cast<std::uint16_t>(number("a pixel", 0, pgm.white)));
      }
      check_end(pgm);
      return pgm;
    }
    if (rest_.empty() || !is_blank(rest_.front())) refuse("has no pixels behind its largest value");
    rest_.remove_prefix(1);
    read_bytes(pgm, count);
    check_end(pgm);
    return pgm;
  }

 private:
  static bool is_blank(char c) {
    return std::string_view(" \t\r\n\v\f").find(c) != std::string_view::npos;
  }

  [[noreturn]] void refuse(const std::string& what) const {
    throw UsageError(fmt::format("{}: the map's image {}", file_, what));
  }
  [[noreturn]] void truncated(std::size_t count) const {
    refuse(fmt::format("is cut off: it has fewer than the {} pixels that it announces", count));
  }

  void skip_blanks() {
    while (!rest_.empty()) {
      if (rest_.front() == '#') {
        rest_.remove_prefix(std::min(rest_.size(), rest_.find('\n')));
      } else if (is_blank(rest_.front())) {
        rest_.remove_prefix(1);
      } else {
        return;
      }
    }
  }

  std::uint32_t number(const char* what, std::uint32_t low, std::uint32_t high) {
    skip_blanks();
    std::uint32_t value = 0;
    const auto [end, error] = std::from_chars(rest_.data(), rest_.data() + rest_.size(), value);
    if (error != std::errc{} || value < low || value > high) {
      refuse(fmt::format("is not readable: {} = \"{}\" must be a whole number in [{}, {}]", what,
                         printable(rest_.substr(0, rest_.find_first_of(" \t\r\n")), 20), low,
                         high));
    }
    rest_.remove_prefix(static_cast<std::size_t>(end - rest_.data()));
    return value;
  }

  void read_bytes(Pgm& pgm, std::size_t count) {
    const std::size_t each = pgm.white > 255 ? 2 : 1;
    if (rest_.size() < each * count) truncated(count);
    pgm.pixels.reserve(count);
    const auto byte = [this](std::size_t i) { return static_cast<unsigned char>(rest_[i]); };
    for (std::size_t i = 0; i < count; ++i) {
      const unsigned value = each == 1 ? byte(i) : byte(2 * i) * 256U + byte(2 * i + 1);
      if (value > pgm.white) {
        refuse(fmt::format("is not readable: a pixel has {}, but the header's maximum is {}", value,
                           pgm.white));
      }
      pgm.pixels.push_back(static_cast<std::uint16_t>(value));
    }
    rest_.remove_prefix(each * count);
  }

  /// Refuses data after the image: with a wrong size in the header, a wrong image would be read.
  void check_end(const Pgm& pgm) {
    skip_blanks();
    if (rest_.empty()) return;
    refuse(
        fmt::format("is larger than the {} x {} pixels that it announces", pgm.columns, pgm.rows));
  }

  std::string file_;
  std::string_view rest_;
};

/// A Netpbm graymap, P2 (text) or P5 (one byte a pixel, or two, the higher first, if white is above
/// 255), with comments; https://netpbm.sourceforge.net/doc/pgm.html. Of several images in a file,
/// the first. Throws UsageError that names the file and what is wrong with it; `what`
/// is what it is, where it cannot be read.
Pgm load_pgm(const std::string& file, const std::string& what) {
  const std::string bytes = read_input(file, what, kMostTableBytes);
  return PgmReader(file, bytes).read();
}

constexpr double kFarthest_m = 1e5;

/// The YAML file; each refusal names it, the line and the key.
class MapFile {
 public:
  explicit MapFile(const std::string& file) : file_(file) {
    const std::string text = read_input(file, "the map", kMostTomlBytes);
    try {
      top_ = YAML::Load(text);
    } catch (const YAML::Exception& error) {
      throw UsageError(fmt::format("{}:{}: {}", file, error.mark.line + 1, printable(error.msg)));
    }
    if (!top_.IsMap()) {
      throw UsageError(
          fmt::format("{}: must be a YAML file with image, resolution, origin, …, as "
                      "map_server has it",
                      file));
    }
    std::set<std::string> keys;
    for (const auto& entry : top_) {
      const std::string key = entry.first.IsScalar() ? entry.first.Scalar() : "";
      if (keys.insert(key).second) continue;
      throw UsageError(fmt::format("{}:{}: {} is there twice", file, entry.first.Mark().line + 1,
                                   printable(key, kLongestNameShown)));
    }
  }

  std::string text(const char* key, const std::string& allowed) const {
    const auto value = read<std::string>(require(key, allowed));
    if (!value || value->empty()) refuse(key, allowed);
    return *value;
  }

  double number(const char* key, double low, double high) const {
    const std::string allowed = fmt::format("must be a number in [{}, {}]", low, high);
    const auto value = read<double>(require(key, allowed));
    const bool good = value && *value >= low && *value <= high;
    if (!good) refuse(key, allowed);
    return *value;
  }

  bool flag(const char* key) const {
    constexpr const char* kAllowed = "must be 0 or 1";
    const YAML::Node node = require(key, kAllowed);
    const auto whole = read<int>(node);
    if (whole == 0 || whole == 1) return *whole == 1;
    const auto flag = read<bool>(node);
    if (!flag || whole) refuse(key, kAllowed);
    return *flag;
  }

  Pose2 pose(const char* key) const {
    const std::string allowed =
        fmt::format("must be [x, y, yaw], x and y within ±{} m, yaw within ±7 rad", kFarthest_m);
    const auto value = read<std::vector<double>>(require(key, allowed));
    const auto within = [](double x, double most) { return std::abs(x) <= most; };
    if (!value || value->size() != 3 || !within((*value)[0], kFarthest_m) ||
        !within((*value)[1], kFarthest_m) || !within((*value)[2], 7.0)) {
      refuse(key, allowed);
    }
    return {(*value)[0], (*value)[1], wrap_angle((*value)[2])};
  }

  void check_mode() const {
    if (!top_["mode"]) return;
    constexpr const char* kAllowed =
        "must be trinary, or not be there (scale and raw are no modes of walls)";
    if (text("mode", kAllowed) != "trinary") refuse("mode", kAllowed);
  }

  [[noreturn]] void refuse(const char* key, const std::string& allowed) const {
    const YAML::Node node = top_[key];
    throw UsageError(fmt::format("{}:{}: {} = {} is not allowed: {}", file_, node.Mark().line + 1,
                                 key, printable(YAML::Dump(node), kLongestValueShown), allowed));
  }

 private:
  template <class T>
  static std::optional<T> read(const YAML::Node& node) {
    try {
      return node.as<T>();
    } catch (const YAML::Exception&) {
      return std::nullopt;
    }
  }

  YAML::Node require(const char* key, const std::string& allowed) const {
    const YAML::Node node = top_[key];
    if (!node) throw UsageError(fmt::format("{}: {} is missing: {}", file_, key, allowed));
    return node;
  }

  std::string file_;
  YAML::Node top_;
};

}  // namespace

OccupancyMap load_occupancy_map(const std::string& yaml_file) {
  const MapFile file(yaml_file);
  const std::string image = file.text("image", "must be the name of a PGM file");
  OccupancyMap map;
  map.resolution_m = file.number("resolution", 1e-3, 100.0);
  map.origin = file.pose("origin");
  const bool negate = file.flag("negate");
  const double occupied_above = file.number("occupied_thresh", 0.0, 1.0);
  if (file.number("free_thresh", 0.0, 1.0) >= occupied_above) {
    file.refuse("free_thresh", fmt::format("must be below occupied_thresh = {}", occupied_above));
  }
  file.check_mode();
  const auto beside = std::filesystem::path(yaml_file).parent_path() / image;
  map.image_file = beside.lexically_normal().string();
  const Pgm pgm = load_pgm(map.image_file, fmt::format("the image of {}", yaml_file));
  map.columns = pgm.columns;
  map.rows = pgm.rows;
  map.occupied.resize(map.columns * map.rows);
  for (std::size_t row = 0; row < map.rows; ++row) {
    for (std::size_t column = 0; column < map.columns; ++column) {
      const double bright =
          static_cast<double>(pgm.pixels[(map.rows - 1 - row) * map.columns + column]) / pgm.white;
      map.occupied[row * map.columns + column] = (negate ? bright : 1.0 - bright) > occupied_above;
    }
  }
  return map;
}

std::vector<Shape> occupied_shapes(const OccupancyMap& map) {
  std::vector<bool> left = map.occupied;
  const auto is_left = [&](std::size_t column, std::size_t row) {
    return left[row * map.columns + column];
  };
  const double c = std::cos(map.origin.yaw_rad), s = std::sin(map.origin.yaw_rad);
  std::vector<Shape> shapes;
  for (std::size_t row = 0; row < map.rows; ++row) {
    for (std::size_t column = 0; column < map.columns; ++column) {
      if (!is_left(column, row)) continue;
      std::size_t end = column + 1, top = row + 1;
      while (end < map.columns && is_left(end, row)) ++end;
      const auto row_is_left = [&](std::size_t y) {
        for (std::size_t x = column; x < end; ++x) {
          if (!is_left(x, y)) return false;
        }
        return true;
      };
      while (top < map.rows && row_is_left(top)) ++top;
      for (std::size_t y = row; y < top; ++y) {
        for (std::size_t x = column; x < end; ++x) left[y * map.columns + x] = false;
      }
      const double x_m = 0.5 * map.resolution_m * static_cast<double>(column + end);
      const double y_m = 0.5 * map.resolution_m * static_cast<double>(row + top);
      shapes.push_back({.pose = {map.origin.x_m + c * x_m - s * y_m,
                                 map.origin.y_m + s * x_m + c * y_m, map.origin.yaw_rad},
                        .length_m = map.resolution_m * static_cast<double>(end - column),
                        .width_m = map.resolution_m * static_cast<double>(top - row)});
    }
  }
  return shapes;
}

double largest_resolution_m(const OccupancyMap& map, const std::vector<Shape>& shapes,
                            double half_extent_m) {
  double share = std::numeric_limits<double>::infinity();  // share of the present cell
  const auto keep_within = [&](double from_m, double to_m) {
    const double way_m = to_m - from_m;
    if (way_m == 0.0) return;
    share = std::min(share, (std::copysign(half_extent_m, way_m) - from_m) / way_m);
  };
  for (const Shape& shape : shapes) {
    for (const Position& p : corners(shape)) {
      keep_within(map.origin.x_m, p.x_m);
      keep_within(map.origin.y_m, p.y_m);
    }
  }
  const bool inside = std::max(std::abs(map.origin.x_m), std::abs(map.origin.y_m)) < half_extent_m;
  return inside ? share * map.resolution_m : 0.0;
}

}  // namespace tether
