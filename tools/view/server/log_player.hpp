#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "common/base/time.hpp"
#include "tools/messages/event_log.hpp"
#include "tools/view/server/playback.hpp"

namespace tether {

/// Where in an LCM event log which message is, in the order of time, so that any place of it is
/// found at once.
class LogIndex {
 public:
  struct Entry {
    Instant time;
    std::uint64_t offset_bytes = 0;  ///< offset of the message's bytes
    std::uint32_t size_bytes = 0;
    std::uint32_t channel = 0;
  };
  static constexpr std::size_t kMostEntries = 50'000'000;

  /// Goes through the whole log. Throws UsageError that begins with `name` if it has more than
  /// `most_entries` events.
  LogIndex(EventLogReader& log, const std::string& name, std::size_t most_entries = kMostEntries);

  const std::vector<Entry>& entries() const { return entries_; }
  const std::string& channel(const Entry& entry) const { return channels_[entry.channel]; }

  /// How many entries are not later than this.
  std::size_t count_until(Instant time) const;

  /// Last entry of each channel among those from `begin` up to, but not including, `end`, in order.
  std::vector<std::size_t> latest(std::size_t begin, std::size_t end) const;

 private:
  std::vector<Entry> entries_;
  std::vector<std::string> channels_;
  std::vector<std::vector<std::uint32_t>> places_;  ///< entries of each channel, in order
};

/// Says which entries of a log are to be shown when. After a jump these are the latest of each
/// channel before the new position, so that what is seen is the state of that time. Played so fast
/// that more than kMostAtOnce come at once, only the latest of each channel are.
class LogPlayer {
 public:
  static constexpr std::size_t kMostAtOnce = 1000;

  /// At the start of the log, paused. `index` outlives it.
  explicit LogPlayer(const LogIndex& index);

  const Playback& playback() const { return playback_; }
  void play(Instant now);
  void pause(Instant now) { playback_.pause(now); }
  void set_speed(Instant now, double speed) { playback_.set_speed(now, speed); }
  void seek(Instant now, Instant position);

  /// Entries that have become due since the last call, in order.
  std::vector<std::size_t> due(Instant now);

 private:
  const LogIndex& index_;
  Playback playback_;
  std::size_t next_ = 0;
  bool jumped_ = true;
};

}  // namespace tether
