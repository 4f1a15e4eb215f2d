#pragma once

#include <cstdint>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

#include "common/scenario/scenario.hpp"
#include "tools/view/server/log_player.hpp"
#include "tools/view/server/view_server.hpp"

namespace tether {

/// An LCM log that is looked at. Beside the log of a run is its scenario.toml: then what it says
/// can be shown too.
class ViewedLog {
 public:
  /// Reads where everything is. Throws UsageError if it is no log or has no event.
  explicit ViewedLog(const std::string& file);

  const std::string& file() const { return file_; }
  const LogIndex& index() const { return *index_; }
  const std::optional<Scenario>& scenario() const { return scenario_; }
  /// Notes on missing parts, for people: where the log is damaged, that it breaks off.
  const std::vector<std::string>& notes() const { return notes_; }

  /// Times are shown from here on: t = 0 of a run's log, the first event of one that has the wall
  /// clock's time.
  Instant zero() const { return zero_; }
  double start_s() const { return to_seconds(index_->entries().front().time - zero_); }
  double end_s() const { return to_seconds(index_->entries().back().time - zero_); }

  /// The bytes of a message; valid until the next call. Empty if the file has changed.
  std::span<const std::uint8_t> read(const LogIndex::Entry& entry);

 private:
  void find_scenario();

  std::string file_;
  std::ifstream stream_;
  std::optional<LogIndex> index_;
  std::optional<Scenario> scenario_;
  std::vector<std::string> notes_;
  Instant zero_ = kStart;
  std::vector<std::uint8_t> bytes_;
};

/// Plays a log to the server's clients, all of which see the same: it begins to play at once, and
/// ends in a pause.
class LogView {
 public:
  LogView(Instant now, ViewedLog& log, ViewServer& server);
  LogView(const LogView&) = delete;
  LogView& operator=(const LogView&) = delete;

  /// Sends what has become due; every 10 ms or so. `now` is a clock that never steps back.
  void advance(Instant now);
  void take(Instant now, const ViewRequest& request);

  static constexpr Duration kPeriod = std::chrono::milliseconds{10};

 private:
  void set(Instant now, const Parameter& parameter);
  void tell(Instant now);

  ViewedLog& log_;
  ViewServer& server_;
  LogPlayer player_;
  Instant told_;
};

}  // namespace tether
