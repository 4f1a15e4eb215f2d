#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "tools/experiment/sweep/database.hpp"
#include "tools/experiment/sweep/experiment.hpp"
#include "tools/experiment/sweep/identity.hpp"
#include "tools/experiment/sweep/run_result.hpp"

namespace tether {

/// A run in the store.
struct StoredRun {
  std::size_t arm;
  std::uint64_t seed;
  RunResult result;  ///< trajectory only if asked for
};

struct FailedRun {
  std::size_t arm;
  std::uint64_t seed;
  std::string why;
};

/// The runs of a sweep, in an SQLite database: one row each, the resolved scenario of each arm, and
/// what the sweep was made from. A run is in it wholly or not at all, whenever the process dies.
///
/// Tables: meta (key, value), arms (arm, settings, scenario), runs (arm, seed, failure, metrics…),
/// trajectories (arm, seed, points: 8 little-endian 32-bit floats each, see TrajectoryPoint).
/// Each row ends with a checksum (`sum`) of its other fields, verified when the row is read: what
/// differs is refused by name. Databases of version 0.1's format have none: they are read as they
/// are, unverified, and are not gone on with. Those from before a metric was added are read with
/// NaN for it, and are not gone on with either.
///
/// Throws UsageError where the database is another experiment's, another version's or none at all,
/// and std::runtime_error where it cannot be read or written; nothing is changed then.
class RunStore {
 public:
  /// Makes the database, or opens the one that the same experiment began.
  static RunStore begin(const std::filesystem::path& file, const Experiment& experiment,
                        const Shard& shard);
  /// A new one, of the whole sweep of which `shard` is a part.
  static RunStore begin_like(const std::filesystem::path& file, const RunStore& shard);
  /// For reading.
  static RunStore open(const std::filesystem::path& file);

  RunStore(RunStore&&) noexcept = default;

  /// All at once. A run that is there already is a bug.
  void add(const std::vector<StoredRun>& runs);

  /// Calls `use` for each run, by arm, then seed.
  void for_each(const std::function<void(const StoredRun&)>& use,
                bool with_trajectories = false) const;
  std::size_t size() const;
  std::size_t failures() const;
  std::optional<FailedRun> first_failure() const;

  /// Adds to the wall time so far.
  void add_wall_time(double wall_time_s);
  /// Puts everything into the database's own file, which is then alone until begin(): it can be
  /// moved once this is gone. Throws std::runtime_error while another process has it open.
  void flush();
  /// Nothing is missing: of the shard, if it is one.
  void set_complete() { write_meta({{"complete", "true"}}); }
  bool is_complete() const { return meta("complete") == "true"; }

  // Origin of the sweep.
  std::string name() const { return meta("name"); }
  std::string version() const { return meta("version"); }
  std::string plant() const { return meta("plant"); }
  double wall_time_s() const { return std::stod(meta("wall_time_s")); }
  Identity identity() const;
  Shard shard() const;
  /// Runs that make it complete; an upper limit where precision decides.
  std::size_t planned_runs() const;
  std::vector<std::string> keys() const;
  std::optional<FigureChoice> figure() const;
  std::vector<TableChoice> tables() const;
  struct StoredArm {
    std::vector<KeyValue> settings;
    std::string scenario;  ///< resolved, as TOML

    bool operator==(const StoredArm&) const = default;
  };
  std::vector<StoredArm> arms() const;
  const std::filesystem::path& file() const { return database_->file(); }

 private:
  explicit RunStore(std::unique_ptr<Database> database) : database_(std::move(database)) {}
  void make(const Identity& identity, const std::vector<StoredArm>& arms);
  void write_meta(const Identity& values);
  void check_contents() const;
  bool has_sums() const;
  const char* sum_column() const { return has_sums() ? ", sum" : ""; }
  void verify(const std::string& row, std::int64_t stored, std::int64_t actual) const;
  std::string meta(const std::string& key) const;

  std::unique_ptr<Database> database_;
};

}  // namespace tether
