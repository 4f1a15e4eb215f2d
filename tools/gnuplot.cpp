#include "tools/gnuplot.hpp"

#include <fmt/format.h>

#include <fstream>
#include <stdexcept>

#include "tools/process.hpp"

namespace tether {

void run_gnuplot(const std::filesystem::path& folder, const std::string& name,
                 const std::string& script) {
  const std::string file = (folder / name).string();
  std::ofstream out(file);
  out << "# Run in this folder: gnuplot " << name << "\n" << script;
  out.close();
  if (!out) throw std::runtime_error(fmt::format("cannot write \"{}\"", file));
  const int code = run_process({"gnuplot", name}, folder);
  if (code == 127) {
    throw std::runtime_error("cannot draw: gnuplot is missing; apt install gnuplot-nox");
  }
  if (code != 0) {
    throw std::runtime_error(fmt::format("gnuplot failed on \"{}\" with exit code {}", file, code));
  }
}

}  // namespace tether
