#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "tools/experiment/store/run_store.hpp"

namespace tether {

/// The runs of the sweeps of a folder, and how to make one of them again.
class SweepRuns {
 public:
  /// Reads which runs there are: those of the folder's databases (databases_below()), now. Throws
  /// UsageError if there is none.
  explicit SweepRuns(const std::filesystem::path& folder);

  /// Whether that is the address of a run, such as "/runs/4/17" or "/runs/f2_prr/4/17"
  /// (address_of_runs()): of combination 4, with seed 17.
  bool has(std::string_view path) const { return find(path).has_value(); }

  /// Computes the run, which is there, again, and writes its log and its scenario.toml into a
  /// folder; returns the log. `progress` receives the completed share, 0 to 1, at each second of
  /// the run; what it throws ends the run. Throws std::runtime_error, with both versions of Tether,
  /// if it cannot be made or its ε is not that of the sweep. Const, and so for any thread.
  std::filesystem::path make_again(std::string_view path, const std::filesystem::path& into,
                                   const std::function<void(double share)>& progress) const;

 private:
  using ArmAndSeed = std::pair<std::size_t, std::uint64_t>;
  struct Sweep {
    std::string address;  ///< "/runs/f2_prr"
    std::string name, version;
    std::filesystem::path file;
    std::vector<RunStore::StoredArm> arms;
    std::map<ArmAndSeed, double> epsilon_m;  ///< NaN: the run failed
  };
  struct Found {
    const Sweep* sweep;
    ArmAndSeed run;
  };
  static Sweep read(const std::filesystem::path& folder, const std::filesystem::path& database);
  std::optional<Found> find(std::string_view path) const;

  std::vector<Sweep> sweeps_;
};

}  // namespace tether
