#include <cmath>
#include <sstream>

#include "netem/models/map_process.hpp"
#include "tests/fuzz/fuzz.hpp"

namespace tether::fuzzing {

void try_input(std::span<const std::uint8_t> input) {
  std::istringstream in(text_of(input));
  takes([&] {
    const PositionMap map = PositionMap::read(in, "map.asc");
    must(map.columns() > 0 && map.rows() > 0, "a map has a cell");
    for (const double x_m : {-1e300, -3.5, 0.0, 7.25, 1e300}) {
      must(std::isfinite(map.at(x_m, -x_m)), "a map has a value everywhere");
    }
  });
}

}  // namespace tether::fuzzing
