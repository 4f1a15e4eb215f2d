#pragma once

#include <cstdint>
#include <istream>
#include <span>
#include <string>
#include <vector>

namespace tether {

/// One record of an LCM event log; refers to the reader's memory until the next call of next().
struct LoggedEvent {
  std::int64_t event_number = 0;
  std::int64_t timestamp_us =
      0;  ///< since 1970 in lcm-logger's logs, since t = 0 in simulated runs
  std::string channel;
  std::span<const std::uint8_t> data;
};

/// A stretch of a log that holds no usable record.
struct LogDamage {
  std::uint64_t offset_bytes = 0;
  std::uint64_t size_bytes = 0;
  bool truncated_tail = false;  ///< the file ends in the middle of a record
};

/// Reads LCM event logs, also ones that broke off or are damaged: it skips what is unusable, goes
/// on at the next record, and says what it skipped. (LCM's own reader ends at the first damage.)
///
/// A log is a sequence of records, in big endian: u32 0xEDA1DA01, i64 event number, i64 time stamp
/// in microseconds, u32 channel length, u32 data length, channel, data. A record counts if its
/// lengths are possible (channel 1..1000 bytes, which is LCM's own rule; data up to 256 MiB) and it
/// is followed by another record's beginning or the end of the file, so that a wrong length does
/// not pass for a message.
class EventLogReader {
 public:
  static constexpr std::uint32_t kMagic = 0xEDA1DA01;
  static constexpr std::size_t kHeaderBytes = 28;

  /// `in` stays open as long as the reader lives. An empty stream is a log without events.
  explicit EventLogReader(std::istream& in) : in_(in) {}

  /// Whether the stream begins as an event log does (or ends before one could tell). Ask before the
  /// first next().
  bool looks_like_log();

  /// The next usable record; false at the end. Throws std::runtime_error if reading fails.
  bool next(LoggedEvent& event);

  /// Damage that next() has skipped so far, in the order of the file.
  const std::vector<LogDamage>& damage() const { return damage_; }

  /// Bytes gone through so far: the file's size once next() has returned false.
  std::uint64_t offset_bytes() const { return base_ + position_; }

 private:
  enum class Verdict { record, not_a_record, breaks_off };
  Verdict judge();
  std::size_t available(std::size_t wanted);
  std::uint64_t big_endian(std::size_t offset, std::size_t size) const;
  bool magic_at(std::size_t offset);
  void skip_to_possible_record();
  void end_damage(std::uint64_t begin, bool truncated);

  std::istream& in_;
  std::vector<std::uint8_t> buffer_;  // the file from base_ on, as far as it has been read
  std::uint64_t base_ = 0;
  std::size_t position_ = 0;      // in buffer_
  std::size_t record_bytes_ = 0;  // size of the record that judge() found
  std::vector<LogDamage> damage_;
};

}  // namespace tether
