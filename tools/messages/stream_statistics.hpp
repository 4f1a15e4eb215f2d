#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "tools/messages/message_printer.hpp"

namespace tether {

/// The two fields that every message of the project carries.
struct MessageStamp {
  std::int64_t utime_us = 0;
  std::int64_t seq = 0;
};

/// Accounts for the numbers (`seq`) of one publisher's messages as they arrive.
///
/// A number that was skipped is missed until it arrives after all; then it is reordered instead.
/// One that comes again is duplicated. A number that leads back but is stamped later, or more than
/// 5 s earlier, than the highest one, or that leads ahead by more than a million, is taken for a
/// publisher that restarted: counted as a restart, and counting goes on from there. A negative
/// number is invalid and otherwise ignored.
class SequenceCounter {
 public:
  struct Counters {
    std::int64_t missed = 0;
    std::int64_t duplicated = 0;
    std::int64_t reordered = 0;
    std::int64_t restarts = 0;
    std::int64_t invalid = 0;
  };

  void on_message(const MessageStamp& stamp);
  const Counters& counters() const { return counters_; }

 private:
  void start(const MessageStamp& stamp);
  void on_higher(const MessageStamp& stamp);
  void on_not_higher(const MessageStamp& stamp);
  bool take_missing(std::int64_t seq);

  Counters counters_;
  bool any_ = false;
  MessageStamp highest_;
  std::int64_t lowest_seq_ = 0;
  std::map<std::int64_t, std::int64_t> missing_;  // first → last number of each gap
};

/// Sizes, rate and timing of one stream of messages.
///
/// Jitter is |interval − median interval| of successive arrivals, so a single late message shows
/// in the upper quantiles and leaves the others alone (lcm-spy's "jitter" is the longest minus the
/// shortest interval of the last second). Quantiles are nearest-rank. Memory is bounded: only the
/// newest kMaxIntervals intervals count.
class StreamStatistics {
 public:
  static constexpr std::size_t kMaxIntervals = 1'000'000;

  struct Jitter {
    double p50_ms = 0.0, p90_ms = 0.0, p99_ms = 0.0, max_ms = 0.0;
  };
  struct Summary {
    std::int64_t count = 0;
    std::int64_t bytes = 0;
    double rate_hz = 0.0;        ///< (count − 1) / (last − first arrival); 0 below two arrivals
    double bandwidth_Bps = 0.0;  ///< rate × mean size
    double median_interval_ms = 0.0;
    Jitter jitter;  ///< zeros below two arrivals
    SequenceCounter::Counters sequence;
  };

  /// `stamp` is absent for messages that could not be decoded.
  void on_message(std::int64_t arrival_us, std::size_t size_bytes,
                  const std::optional<MessageStamp>& stamp);
  Summary summary() const;
  const SequenceCounter::Counters& sequence() const { return sequence_.counters(); }

 private:
  SequenceCounter sequence_;
  std::int64_t count_ = 0;
  std::int64_t bytes_ = 0;
  std::int64_t first_arrival_us_ = 0;
  std::int64_t last_arrival_us_ = 0;
  std::vector<std::int64_t> intervals_us_;  // a ring once full
  std::size_t oldest_ = 0;
};

/// The smallest element that at least `quantile` (0..1) of all elements do not exceed
/// (nearest rank); `sorted` is not empty.
double nearest_rank(const std::vector<double>& sorted, double quantile);

/// Statistics per channel, for a summary at the end.
///
/// The number of channels is bounded, since anybody on the network can invent them: messages of
/// further ones are only counted.
class ChannelTable {
 public:
  static constexpr std::size_t kMaxChannels = 1000;

  void on_message(std::string_view channel, std::int64_t arrival_us, const MessageContent& message);

  std::vector<std::string> channels() const;
  std::int64_t undecodable() const;

  /// A table, one line a channel, and a line for whatever is out of the ordinary. Ends with a
  /// newline.
  std::string format() const;

 private:
  struct Channel {
    std::string type;  // type of the newest message
    std::int64_t type_changes = 0;
    std::int64_t undecodable = 0;  // messages of a known type that are not decodable
    StreamStatistics statistics;
  };
  std::string notes() const;

  std::map<std::string, Channel, std::less<>> channels_;
  std::int64_t beyond_limit_ = 0;
};

}  // namespace tether
