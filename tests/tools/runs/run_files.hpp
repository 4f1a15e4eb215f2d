#pragma once

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <string>

#include "tools/loop/closed_loop.hpp"
#include "tools/runs/output_folder.hpp"
#include "tools/runs/run_observer.hpp"
#include "tools/runs/run_summary.hpp"

namespace tether::testing {

/// A temporary folder.
struct Folder {
  std::filesystem::path path;
  Folder() {
    std::string name = (std::filesystem::temp_directory_path() / "tether-loop-XXXXXX").string();
    path = mkdtemp(name.data());
  }
  ~Folder() { std::filesystem::remove_all(path); }
};

inline std::string contents(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// A whole run with its files, as `tether run --out` does it.
inline void run_into(const std::filesystem::path& path, const Scenario& scenario) {
  OutputFolder folder(path, scenario);
  ClosedLoop loop(scenario);
  RunObserver observer(scenario, loop.loop(), loop.bus());
  folder.record(loop.loop(), loop.bus());
  loop.run();
  folder.write(scenario, observer, to_json(scenario, observer, {}));
}

/// What a run wrote, to compare.
struct Files {
  std::size_t log_hash, trajectory_hash;
  std::uintmax_t log_size;
  bool operator==(const Files&) const = default;
};

inline Files run_and_hash(const Scenario& scenario) {
  const Folder folder;
  run_into(folder.path, scenario);
  const std::string log = contents(folder.path / "run.lcmlog");
  return {std::hash<std::string>{}(log),
          std::hash<std::string>{}(contents(folder.path / "trajectory.csv")), log.size()};
}

}  // namespace tether::testing
