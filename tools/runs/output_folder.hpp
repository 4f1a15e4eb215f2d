#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "common/node/bus.hpp"
#include "common/node/event_loop.hpp"
#include "common/scenario/scenario.hpp"
#include "tools/runs/run_observer.hpp"

namespace lcm {
class LogFile;
}

namespace tether {

/// The scenario with full names of the files that it reads, from the current folder: it can be
/// written to any other.
Scenario with_absolute_names(Scenario scenario);

/// Records every message of a bus as a genuine LCM event log, stamped with the run's time.
class EventLogWriter {
 public:
  /// Throws UsageError if the file cannot be created.
  EventLogWriter(const std::filesystem::path& file, EventLoop& loop, Bus& bus);
  ~EventLogWriter();
  EventLogWriter(const EventLogWriter&) = delete;
  EventLogWriter& operator=(const EventLogWriter&) = delete;

  /// Closes the file; throws with the system's reason if not everything reached the disk. A failed
  /// write is reported on standard error within half a second of the run's time, and ends the
  /// recording.
  void close();

 private:
  void write(const Message& message);
  void fail();

  std::filesystem::path file_;
  EventLoop& loop_;
  std::unique_ptr<lcm::LogFile> log_;
  std::uintmax_t bytes_ = 0;
  std::int64_t events_ = 0;
  Instant next_flush_ = Instant::min();
  std::string failure_;  // why the recording ended
};

/// The folder of a run's results: run.lcmlog while it runs, the rest when it is over.
class OutputFolder {
 public:
  /// Creates the folder, or takes one that is empty or holds nothing but an earlier run's results,
  /// which are replaced, and writes scenario.toml. Throws UsageError for anything else, so that no
  /// foreign file is lost, and where gnuplot is missing, before any time is spent on the run.
  OutputFolder(const std::filesystem::path& folder, const Scenario& scenario);

  const std::filesystem::path& path() const { return folder_; }

  /// Starts run.lcmlog.
  void record(EventLoop& loop, Bus& bus);

  /// Writes trajectory.csv (of a fleet trajectories.csv, a block for each vehicle) and
  /// path.{gp,svg,png}, closes run.lcmlog, and writes summary.json last: its presence says that the
  /// folder is complete.
  void write(const Scenario& scenario, const FleetObserver& run, const std::string& summary_json);

  /// Output of a run that broke off: trajectory.csv and run.lcmlog as far as they go, and
  /// incomplete.txt, which says why. There is no summary.json then.
  void write_incomplete(const FleetObserver& run, const std::string& why);

 private:
  void write_trajectories(const FleetObserver& run);

  std::filesystem::path folder_;
  std::unique_ptr<EventLogWriter> log_;
};

}  // namespace tether
