#pragma once

#include <filesystem>
#include <functional>
#include <string>

#include "tests/support/folder.hpp"
#include "tools/nodes/closed_loop.hpp"
#include "tools/runs/output_folder.hpp"
#include "tools/runs/run_summary.hpp"

namespace tether::test {

/// A whole run with its files, as `tether run --out` does it.
inline void run_into(const std::filesystem::path& path, const Scenario& scenario) {
  OutputFolder folder(path, scenario);
  ClosedLoop loop(scenario);
  FleetObserver observer(loop.members(), loop.loop(), loop.bus());
  folder.record(loop.loop(), loop.bus());
  loop.run();
  folder.write(scenario, observer, to_json(scenario, observer, {}));
}

/// Files that a run wrote, to compare.
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

}  // namespace tether::test
