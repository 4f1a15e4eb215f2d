#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace tether {

/// A grey image.
struct Pgm {
  std::size_t columns = 0;
  std::size_t rows = 0;
  std::uint32_t white = 255;          ///< a pixel's largest value, 1 … 65535
  std::vector<std::uint16_t> pixels;  ///< row after row, the upper one first
};

/// A Netpbm graymap, P2 (text) or P5 (one byte a pixel, or two, the higher first, if white is above
/// 255), with comments; https://netpbm.sourceforge.net/doc/pgm.html. Of several images in a file,
/// the first. Throws UsageError that names the file and what is wrong with it; `what`
/// is what it is, where it cannot be read.
Pgm load_pgm(const std::string& file, const std::string& what);

}  // namespace tether
