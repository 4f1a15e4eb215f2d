#pragma once

#include <functional>
#include <istream>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/random.hpp"
#include "netem/link/channel_process.hpp"
#include "netem/models/shadowing.hpp"

namespace tether {

/// Values on a grid of positions in the world's frame.
///
/// Esri ASCII raster, as GIS programs and numpy write it: a header of the lines `ncols`, `nrows`,
/// `xllcorner` and `yllcorner` (the lower left corner of the lower left cell, m; or `xllcenter` and
/// `yllcenter`, its centre), `cellsize` (m), optionally `NODATA_value`; then ncols·nrows numbers,
/// row by row from the largest y down. Each stands for the centre of its cell.
class PositionMap {
 public:
  /// Throws UsageError "name:line: …" for what is not such a file, and for cells without data.
  static PositionMap read(std::istream& in, const std::string& name);
  static PositionMap load(const std::string& file);
  /// The same, read once while the file stays as it is.
  static std::shared_ptr<const PositionMap> kept(const std::string& file);

  /// Bilinear between the centres of cells; beyond the outermost ones, the value at their edge.
  double at(double x_m, double y_m) const;

  std::size_t columns() const { return columns_; }
  std::size_t rows() const { return rows_; }

 private:
  PositionMap() = default;
  double cell(std::size_t column, std::size_t row_from_below) const;

  std::size_t columns_ = 0, rows_ = 0;
  double x_m_ = 0.0, y_m_ = 0.0;  // centre of the lower left cell
  double cell_size_m_ = 1.0;
  std::vector<double> values_;  // rows as in the file: from above
};

/// A function given by points [[x, y], …] with ascending x: linear between them, constant beyond.
class Curve {
 public:
  /// Throws UsageError, naming `key`, unless there are two or more points with ascending x and y in
  /// [low, high].
  Curve(const std::vector<std::vector<double>>& points, double low, double high,
        const std::string& key);
  double at(double x) const;

 private:
  std::vector<std::vector<double>> points_;
};

/// Conditions by the vehicle's position: MapProcess has the formulas. SNR comes
/// from a file or from access points, one of the two.
struct MapConfig {
  std::string file;  ///< grid of SNR in dB, Esri ASCII raster (position_map in map_process.cpp)
  /// [[x_m, y_m], …] in the world's frame, or [[x_m, y_m, snr_1m_db], …].
  std::vector<std::vector<double>> access_points;
  double snr_1m_db = 60.0;          ///< access points: SNR at 1 m, where they do not give their own
  double path_loss_exponent = 3.0;  ///< access points
  double handover_s = 0.0;          ///< access points: interruption at a change
  double shadowing_sd_db = 0.0;     ///< log-normal shadowing: standard deviation; 0 = none
  double shadowing_distance_m = 10.0;  ///< at which its correlation has fallen to 1/e

  double snr50_db = 10.0;  ///< logistic curve: SNR at which half of the packets get through
  double slope_db = 1.0;   ///< logistic curve: prr = 1/(1 + exp(−(snr − snr50)/slope))
  std::vector<std::vector<double>> prr_curve;  ///< instead: [[snr_db, prr], …], linear between
  double delay_ms = 0.0;
  std::vector<std::vector<double>> delay_curve;  ///< instead: [[snr_db, delay_ms], …]

  bool operator==(const MapConfig&) const = default;
};

/// The random stream of the shadowing around an access point ("<x_m>,<y_m>") or of a grid ("grid").
using ShadowingStreams = std::function<RandomEngine(std::string_view place)>;

/// Conditions by the vehicle's position; (0, 0) until the first one is known.
///
/// SNR in dB, of a grid (config.file) or of the nearest access point at distance d (never below
/// 1 m): snr_1m_db − 10·n·log10(d/1 m), n the path-loss exponent (Rappaport, Wireless
/// Communications, section 4.9); plus shadowing, a field of its own for each access point, one
/// realisation a run: both directions between two places have the same (reciprocity). PRR and delay
/// are functions of the SNR: logistic (or config.prr_curve), and constant (or config.delay_curve).
/// When another access point becomes the nearest, nothing gets through for handover_s.
///
/// state(): which access point, in the order of the scenario; 0 for grids.
class MapProcess final : public ChannelProcess {
 public:
  /// Takes `grid` in place of config.access_points if there is one. Throws UsageError, naming
  /// `key_prefix`, for what makes no sense in `config`.
  MapProcess(const MapConfig& config, std::shared_ptr<const PositionMap> grid,
             const std::string& key_prefix, const ShadowingStreams& shadowing);

  void advance(Instant now) override;
  void on_position(double x_m, double y_m, Instant now) override;
  bool wants_position() const override { return true; }
  LinkCondition condition() const override;
  int state() const override { return static_cast<int>(nearest_); }
  /// The end of a handover; Instant::max() if there is none.
  Instant next_transition() const override;

  /// Where the vehicle was last; nullopt before the first position.
  struct Position {
    double x_m, y_m;
  };
  std::optional<Position> position() const { return position_; }

  /// At a position; dB.
  double snr_db(double x_m, double y_m) const;
  LinkCondition condition_at_snr(double snr_db) const;

 private:
  struct AccessPoint {
    double x_m, y_m, snr_1m_db;
  };
  std::size_t nearest_to(double x_m, double y_m) const;
  void move_to(double x_m, double y_m);

  MapConfig config_;
  std::shared_ptr<const PositionMap> grid_;
  std::vector<AccessPoint> access_points_;
  std::vector<Shadowing> shadowing_;  // one per access point, or one
  std::optional<Curve> prr_curve_, delay_curve_;
  std::size_t nearest_ = 0;
  Instant now_ = Instant::min();
  Instant handover_until_ = Instant::min();
  std::optional<Position> position_;
  LinkCondition condition_;
};

/// Reads config.file, if there is one. Throws UsageError for what is wrong with it or with
/// `config`; `key_prefix`, such as "channel.uplink.map.", is for messages about keys.
std::shared_ptr<ChannelProcess> make_map_process(const MapConfig& config,
                                                 const std::string& key_prefix,
                                                 const ShadowingStreams& shadowing);

}  // namespace tether
