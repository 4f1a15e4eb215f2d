#include "tools/base/gnuplot.hpp"

#include <fmt/format.h>

#include <stdexcept>

#include "tools/base/process.hpp"
#include "tools/base/replacing_output.hpp"

namespace tether {

void run_gnuplot(const std::filesystem::path& folder, const std::string& name,
                 const std::string& script) {
  const std::string file = (folder / name).string();
  write_file(file, fmt::format("# Run in this folder: gnuplot {}\n{}", name, script));
  const int code = run_process({"gnuplot", name}, folder);
  if (code == 127) {
    throw std::runtime_error("cannot draw: gnuplot is missing; apt install gnuplot-nox");
  }
  if (code != 0) {
    throw std::runtime_error(fmt::format("gnuplot failed on \"{}\" with exit code {}", file, code));
  }
}

}  // namespace tether
