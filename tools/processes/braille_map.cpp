#include "tools/processes/braille_map.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace tether {
namespace {

constexpr int kDotsAcross = 2, kDotsDown = 4;
/// Unicode 15, section 21.1: the bit of each dot, by row and column.
constexpr std::array<std::array<std::uint8_t, kDotsAcross>, kDotsDown> kBits{
    {{0x01, 0x08}, {0x02, 0x10}, {0x04, 0x20}, {0x40, 0x80}}};
/// East first, then to the left.
constexpr std::array<const char*, 8> kArrows{"→", "↗", "↑", "↖", "←", "↙", "↓", "↘"};

/// Index of a cell in a map of `rows` rows and twice as many columns.
std::size_t place(int rows, int row, int column) {
  return 2 * static_cast<std::size_t>(rows) * static_cast<std::size_t>(row) +
         static_cast<std::size_t>(column);
}

/// U+2800 + dots in UTF-8.
std::string braille(std::uint8_t dots) {
  return {'\xe2', static_cast<char>(0xa0 | (dots >> 6U)), static_cast<char>(0x80 | (dots & 0x3fU))};
}

}  // namespace

BrailleMap::BrailleMap(int rows, double half_extent_m)
    : rows_(rows), half_extent_m_(half_extent_m), cells_(place(rows, rows, 0)) {}

void BrailleMap::dot(double x_m, double y_m, bool bright) {
  const int size = rows_ * kDotsDown;
  const double scale = size / (2.0 * half_extent_m_);
  const double across = std::floor((x_m + half_extent_m_) * scale);
  const double down = std::floor((half_extent_m_ - y_m) * scale);
  if (!(across >= 0.0 && across < size && down >= 0.0 && down < size)) return;
  const int column = static_cast<int>(across), row = static_cast<int>(down);
  Cell& cell = cells_[place(rows_, row / kDotsDown, column / kDotsAcross)];
  cell.dots |= kBits[static_cast<std::size_t>(row % kDotsDown)]
                    [static_cast<std::size_t>(column % kDotsAcross)];
  cell.bright = cell.bright || bright;
}

void BrailleMap::arrow(double x_m, double y_m, double yaw_rad) {
  if (!std::isfinite(x_m) || !std::isfinite(y_m) || !std::isfinite(yaw_rad)) return;
  const double cell_m = 2.0 * half_extent_m_ / rows_;  // its height
  const auto index = [&](double from_edge_m, double size_m, int count) {
    return std::clamp(static_cast<int>(std::clamp(from_edge_m / size_m, 0.0, 1e6)), 0, count - 1);
  };
  const int row = index(half_extent_m_ - y_m, cell_m, rows_);
  const int column = index(x_m + half_extent_m_, cell_m / 2.0, 2 * rows_);
  const auto eighth =
      std::lround(std::remainder(yaw_rad, 2.0 * std::numbers::pi) / (std::numbers::pi / 4.0));
  cells_[place(rows_, row, column)].symbol = kArrows[static_cast<std::size_t>((eighth + 8) % 8)];
}

std::vector<std::string> BrailleMap::lines() const {
  std::vector<std::string> all;
  for (int row = 0; row < rows_; ++row) {
    std::string line;
    for (int column = 0; column < 2 * rows_; ++column) {
      const Cell& cell = cells_[place(rows_, row, column)];
      if (cell.symbol != nullptr) {
        line += std::string("\033[1m") + cell.symbol + "\033[0m";
      } else if (cell.dots == 0) {
        line += ' ';
      } else {
        line += cell.bright ? braille(cell.dots) : "\033[2m" + braille(cell.dots) + "\033[0m";
      }
    }
    all.push_back(line);
  }
  return all;
}

}  // namespace tether
