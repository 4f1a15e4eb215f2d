#include "common/world/occupancy_map.hpp"

#include <algorithm>
#include <cmath>

#include "tests/fuzz/fuzz.hpp"
#include "tests/support/folder.hpp"

namespace tether::fuzzing {

/// An image, where it begins as one, else the map's YAML file.
void try_input(std::span<const std::uint8_t> input) {
  static const test::Folder folder;
  const std::string text = text_of(input);
  const bool is_image = text.starts_with('P');
  folder.file("room.pgm", is_image ? text : "P2 2 2 255 0 254 205 0");
  const auto yaml = folder.file("room.yaml", is_image ? "image: room.pgm\nresolution: 0.2\n"
                                                        "origin: [1, 2, 0.3]\nnegate: 0\n"
                                                        "occupied_thresh: 0.65\nfree_thresh: 0.25\n"
                                                      : text);
  takes([&] {
    const OccupancyMap map = load_occupancy_map(yaml.string());
    must(map.occupied.size() == map.columns * map.rows, "a map has all of its cells");
    double area_m2 = 0.0;
    for (const Shape& shape : occupied_shapes(map)) {
      must(std::isfinite(shape.pose.x_m) && std::isfinite(shape.pose.y_m), "cells are somewhere");
      area_m2 += shape.length_m * shape.width_m;
    }
    const auto cells = static_cast<double>(std::ranges::count(map.occupied, true));
    must(std::abs(area_m2 / (map.resolution_m * map.resolution_m) - cells) <= 1e-6 * (cells + 1.0),
         "rectangles cover the occupied cells");
  });
}

}  // namespace tether::fuzzing
