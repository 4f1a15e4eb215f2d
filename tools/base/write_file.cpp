#include "tools/base/write_file.hpp"

#include <fmt/format.h>

#include <fstream>
#include <stdexcept>

namespace tether {

void write_file(const std::filesystem::path& file, const std::string& text) {
  std::ofstream out(file, std::ios::binary);
  out << text;
  out.close();
  if (!out) throw std::runtime_error(fmt::format("cannot write \"{}\"", file.string()));
}

}  // namespace tether
