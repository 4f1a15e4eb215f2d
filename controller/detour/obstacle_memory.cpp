#include "controller/detour/obstacle_memory.hpp"

#include <cmath>

namespace tether {
namespace {

constexpr double kMemoryCell_m = 0.1;
constexpr std::size_t kMostCells = 5000;

}  // namespace

void ObstacleMemory::add(Instant now, const std::vector<Position>& points) {
  for (const Position& p : points) {
    const std::pair cell{std::llround(p.x_m / kMemoryCell_m), std::llround(p.y_m / kMemoryCell_m)};
    if (seen_.size() < kMostCells || seen_.contains(cell)) seen_[cell] = now;
  }
}

void ObstacleMemory::forget_before(Instant when) {
  std::erase_if(seen_, [when](const auto& entry) { return entry.second < when; });
}

std::vector<Position> ObstacleMemory::points() const {
  std::vector<Position> points;
  points.reserve(seen_.size());
  for (const auto& [cell, when] : seen_) {
    points.push_back({static_cast<double>(cell.first) * kMemoryCell_m,
                      static_cast<double>(cell.second) * kMemoryCell_m});
  }
  return points;
}

}  // namespace tether
