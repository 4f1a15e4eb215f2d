#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "common/base/time.hpp"
#include "tools/messages/event_log.hpp"

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

}  // namespace tether
