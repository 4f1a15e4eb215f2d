#include "netem/models/map_process.hpp"

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
#include "netem/models/kinds.hpp"

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

namespace {

constexpr Range kPosition{-1e6, 1e6, false};  // m, dB, ms

std::vector<ScenarioKey> keys(const LinkField& field) {
  auto t = field.keys_of<MapConfig>("map");
  t.file("file", &MapConfig::file, "Esri ASCII raster of SNR in dB; or ...");
  t.rows("access_points", &MapConfig::access_points, kPosition,
         "... [[x_m, y_m], ...] or [[x_m, y_m, snr_1m_db], ...]");
  t.number("snr_1m_db", &MapConfig::snr_1m_db, {-200.0, 300.0, false},
           "access points: SNR at a distance of 1 m");
  t.number("path_loss_exponent", &MapConfig::path_loss_exponent, {0.0, 10.0, false},
           "access points: SNR falls by 10 times this per decade of distance");
  t.number("handover_s", &MapConfig::handover_s, {0.0, 1e3, false},
           "access points: interruption after a change of the access point");
  t.number("shadowing_sd_db", &MapConfig::shadowing_sd_db, {0.0, 50.0, false},
           "standard deviation of log-normal shadowing; 0 = none");
  t.number("shadowing_distance_m", &MapConfig::shadowing_distance_m, {1e-3, 1e6, false},
           "distance at which the shadowing's correlation is 1/e");
  t.number("snr50_db", &MapConfig::snr50_db, {-200.0, 300.0, false},
           "SNR at which half of the packets get through");
  t.number("slope_db", &MapConfig::slope_db, {1e-3, 100.0, false},
           "prr = 1/(1 + exp(-(snr - snr50_db)/slope_db))");
  t.rows("prr_curve", &MapConfig::prr_curve, kPosition,
         "instead of the two: [[snr_db, prr], ...], linear between");
  t.number("delay_ms", &MapConfig::delay_ms, kDelayRange_ms, "delay everywhere");
  t.rows("delay_curve", &MapConfig::delay_curve, kPosition,
         "instead: [[snr_db, delay_ms], ...], linear between");
  return t.take();
}

/// Keys of what the others replace, and of shadowing that is not there.
std::string why_no_effect(const std::string& prefix, const LinkConfig& link,
                          const std::string& part) {
  const auto& map = link.own.get<MapConfig>();
  const auto is_one_of = [key = part.substr(std::string_view("map.").size())](
                             std::initializer_list<std::string_view> keys) {
    return std::find(keys.begin(), keys.end(), key) != keys.end();
  };
  if (map.shadowing_sd_db == 0.0 && is_one_of({"shadowing_distance_m"})) {
    return fmt::format("{}map.shadowing_sd_db is 0", prefix);
  }
  if (!map.file.empty() && is_one_of({"snr_1m_db", "path_loss_exponent", "handover_s"})) {
    return fmt::format("{}map.file is given", prefix);
  }
  if (!map.prr_curve.empty() && is_one_of({"snr50_db", "slope_db"})) {
    return fmt::format("{}map.prr_curve is given", prefix);
  }
  if (!map.delay_curve.empty() && is_one_of({"delay_ms"})) {
    return fmt::format("{}map.delay_curve is given", prefix);
  }
  return "";
}

ProcessPtr make(const ProcessNeeds& needs) {
  if (needs.shared) return needs.shared;
  if (needs.same<MapConfig>()) return needs.present;
  // Obstacles shadow every link: the streams are not the link's.
  ProcessPtr made =
      make_map_process(needs.link.own.get<MapConfig>(), needs.prefix + "map.",
                       [seed = needs.seed](std::string_view place) {
                         return random_stream(seed, "shadowing/" + std::string(place));
                       });
  const auto old = needs.present_as<MapProcess>();
  if (const auto where = old ? old->position() : std::nullopt) {
    made->on_position(where->x_m, where->y_m, needs.now);
  }
  return made;
}

void export_loss(const LinkConfig&, const TcSender&, TcDraft& out) {
  out.notes.emplace_back("model = \"map\" has no equivalent: netem knows no position");
  out.command += tc_random_loss(out.loss);
}

}  // namespace

MapProcess::MapProcess(const MapConfig& config, std::shared_ptr<const PositionMap> grid,
                       const std::string& key_prefix, const ShadowingStreams& shadowing)
    : config_(config), grid_(std::move(grid)) {
  for (const auto& point : config.access_points) {
    if (point.size() != 2 && point.size() != 3) {
      throw UsageError(fmt::format(
          "{}access_points: each must be [x_m, y_m] or [x_m, y_m, snr_1m_db]", key_prefix));
    }
    access_points_.push_back({point[0], point[1], point.size() == 3 ? point[2] : config.snr_1m_db});
  }
  if ((grid_ != nullptr) != access_points_.empty()) {
    throw UsageError(
        fmt::format("model = \"map\" needs one of {0}file and {0}access_points", key_prefix));
  }
  if (!config.prr_curve.empty()) {
    prr_curve_.emplace(config.prr_curve, 0.0, 1.0, key_prefix + "prr_curve");
  }
  if (!config.delay_curve.empty()) {
    delay_curve_.emplace(config.delay_curve, 0.0, 1e6, key_prefix + "delay_curve");
  }
  const auto add_shadowing = [&](const std::string& place) {
    RandomEngine random = shadowing(place);
    shadowing_.emplace_back(config.shadowing_sd_db, config.shadowing_distance_m, random);
  };
  if (grid_) add_shadowing("grid");
  for (const AccessPoint& ap : access_points_) add_shadowing(fmt::format("{},{}", ap.x_m, ap.y_m));
  move_to(0.0, 0.0);
}

std::size_t MapProcess::nearest_to(double x_m, double y_m) const {
  std::size_t nearest = 0;
  double shortest = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < access_points_.size(); ++i) {
    const double d = std::hypot(x_m - access_points_[i].x_m, y_m - access_points_[i].y_m);
    if (d >= shortest) continue;
    shortest = d;
    nearest = i;
  }
  return nearest;
}

double MapProcess::snr_db(double x_m, double y_m) const {
  const std::size_t i = nearest_to(x_m, y_m);
  const double shadowing_db = shadowing_[i].at(x_m, y_m);
  if (grid_) return grid_->at(x_m, y_m) + shadowing_db;
  const AccessPoint& ap = access_points_[i];
  const double distance_m = std::max(1.0, std::hypot(x_m - ap.x_m, y_m - ap.y_m));
  return ap.snr_1m_db - 10.0 * config_.path_loss_exponent * std::log10(distance_m) + shadowing_db;
}

LinkCondition MapProcess::condition_at_snr(double snr_db) const {
  const double prr = prr_curve_
                         ? prr_curve_->at(snr_db)
                         : 1.0 / (1.0 + std::exp((config_.snr50_db - snr_db) / config_.slope_db));
  const double delay_ms = delay_curve_ ? delay_curve_->at(snr_db) : config_.delay_ms;
  return {prr, from_seconds(delay_ms * 1e-3)};
}

void MapProcess::move_to(double x_m, double y_m) {
  nearest_ = nearest_to(x_m, y_m);
  condition_ = condition_at_snr(snr_db(x_m, y_m));
}

void MapProcess::advance(Instant now) { now_ = std::max(now_, now); }

void MapProcess::on_position(double x_m, double y_m, Instant now) {
  advance(now);
  constexpr double kFarthest_m = 1e9;  // positions come from the network: keep the last good one
  if (!(std::abs(x_m) <= kFarthest_m && std::abs(y_m) <= kFarthest_m)) return;
  if (position_ && position_->x_m == x_m && position_->y_m == y_m) return;  // nothing is another
  const std::size_t before = nearest_;
  move_to(x_m, y_m);
  if (position_ && nearest_ != before) {
    handover_until_ = now_ + from_seconds(config_.handover_s);
  }
  position_ = {x_m, y_m};
}

LinkCondition MapProcess::condition() const {
  return now_ < handover_until_ ? LinkCondition{0.0, condition_.delay} : condition_;
}

Instant MapProcess::next_transition() const {
  return now_ < handover_until_ ? handover_until_ : Instant::max();
}

std::shared_ptr<ChannelProcess> make_map_process(const MapConfig& config,
                                                 const std::string& key_prefix,
                                                 const ShadowingStreams& shadowing) {
  std::shared_ptr<const PositionMap> grid;
  try {
    if (!config.file.empty()) grid = PositionMap::kept(config.file);
  } catch (const UsageError& error) {
    throw UsageError(fmt::format("{}file: {}", key_prefix, error.what()));
  }
  return std::make_shared<MapProcess>(config, std::move(grid), key_prefix, shadowing);
}

ChannelModelKind map_model() {
  ChannelModelKind kind{.name = "map", .needs_position = true, .keys = keys};
  kind.not_shared = same_settings<MapConfig>;
  kind.moves = [](const LinkConfig&) { return ChannelModelKind::Moves::in_time; };
  kind.why_no_effect = why_no_effect;
  kind.make = make;
  kind.why_open = "where the vehicle is decides";
  kind.export_loss = export_loss;
  return kind;
}

}  // namespace tether
