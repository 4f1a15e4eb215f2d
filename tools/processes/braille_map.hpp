#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace tether {

/// A square of the floor from above in a terminal, north (y) up: a cell has two by four Braille
/// dots (Unicode U+2800 to U+28FF), which are about as far apart across as along. Pure.
class BrailleMap {
 public:
  /// `rows` lines of twice as many columns; the world is x and y in ±half_extent_m.
  BrailleMap(int rows, double half_extent_m);

  /// Dots beyond the edge are left out. A faint one leaves a cell bright that is.
  void faint_dot(double x_m, double y_m) { dot(x_m, y_m, false); }
  void bright_dot(double x_m, double y_m) { dot(x_m, y_m, true); }
  /// An arrow in bold, in the one of eight directions that is nearest to `yaw_rad`; at the edge if
  /// it is beyond.
  void arrow(double x_m, double y_m, double yaw_rad);

  /// From north to south, each 2 `rows` columns wide with escape sequences (SGR) for faint and
  /// bold.
  std::vector<std::string> lines() const;

 private:
  struct Cell {
    std::uint8_t dots = 0;
    bool bright = false;
    const char* symbol = nullptr;
  };
  void dot(double x_m, double y_m, bool bright);

  int rows_;
  double half_extent_m_;
  std::vector<Cell> cells_;  ///< by rows, the northernmost first
};

}  // namespace tether
