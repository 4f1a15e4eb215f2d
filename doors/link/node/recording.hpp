#pragma once

#include <cstdint>
#include <fstream>
#include <map>
#include <optional>
#include <string>
#include <tether/path_fates_t.hpp>
#include <utility>

namespace tether::link {

struct RecordSettings {
  std::string folder = ".";
  std::string peer;         ///< only of this one; "": of all
  bool same_clock = false;  ///< the peer's clock is ours, or set to it: delays are as stamped
};

/// Files of what became of the peers' datagrams, one for each peer and path, named PEER-PATH.csv:
///
///     time_s,lost,delay_ms
///
/// a row for each datagram that the peer sent, in the order of sending; time_s from the first, to
/// the nanosecond and increasing, by the peer's clock. Delays are those of the stamps plus the
/// middle of the interval in which the clocks' offset lies, never negative; half of its width is
/// their error. Rows begin when the offset is known. `tether netem fit` and the channel's trace
/// model read such files.
///
/// Where the peer's clock was set, back or by more than a day, the time goes on from the row
/// before.
class Recording {
 public:
  explicit Recording(RecordSettings settings) : settings_(std::move(settings)) {}

  /// Appends to the file. Throws UsageError that names the file: if it exists already, which is
  /// never overwritten, if two paths would have one name, or if it cannot be written.
  void take(const path_fates_t& message);

  /// A line for each file, for people; "" if there is none.
  std::string summary() const;

 private:
  struct File {
    std::string name;
    std::ofstream out;
    std::int64_t last_ns = 0;             // time_s of the last row
    std::optional<std::int64_t> sent_ns;  // time of sending, by the peer's clock
    std::int64_t rows = 0, lost = 0;
    std::int64_t run = 0, bursts = 0, in_bursts = 0, longest = 0;
    std::int64_t gaps = 0;  // stretches of which nothing is known
    double gaps_s = 0.0;
    std::int64_t without_delay = 0;
    double delay_sum_ms = 0.0, delay_most_ms = 0.0;
    double error_ms = 0.0;       // the largest
    bool clocks_differ = false;  // although declared the same
  };

  File& file_of(const path_fates_t& message);
  static void add_row(File& file, const path_fates_t& message, std::size_t row, double offset_ms);

  RecordSettings settings_;
  std::map<std::pair<std::string, std::string>, File> files_;  // by peer and path
};

}  // namespace tether::link
