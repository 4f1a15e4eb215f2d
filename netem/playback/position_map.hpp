#pragma once

#include <istream>
#include <memory>
#include <string>
#include <vector>

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

}  // namespace tether
