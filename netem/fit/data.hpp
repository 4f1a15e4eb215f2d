#pragma once

#include <cstdint>
#include <limits>
#include <vector>

namespace tether {

/// A packet that arrived.
struct Reception {
  std::int64_t seq = 0;
  double time_s = 0.0;  ///< time of arrival, by any clock
  /// From sending to arrival; NaN if unknown.
  double delay_s = std::numeric_limits<double>::quiet_NaN();
};

/// A packet that was sent.
struct LoggedPacket {
  double time_s = 0.0;
  bool lost = false;
  double delay_s = std::numeric_limits<double>::quiet_NaN();
};

/// Fates of a stream of packets on a channel, in the order of sending.
struct FateLog {
  /// Stretches of consecutive packets; a new one begins where the sender restarted.
  std::vector<std::vector<LoggedPacket>> segments;
  /// The sender is periodic: the times are replaced by multiples of its period.
  bool periodic = false;
  double interval_s = 0.0;      ///< mean time between packets; 0 below two
  std::int64_t duplicated = 0;  ///< arrivals of a number that had arrived
  std::int64_t reordered = 0;   ///< arrivals after a higher number
  /// Arrivals whose number does not fit the times (see divide_into_runs()), and segments of which
  /// fewer than one packet in 1000 arrived, left out.
  std::int64_t implausible = 0;

  std::int64_t packets() const;
  std::int64_t lost() const;
};

/// Which packets were lost, from the numbers of those that arrived, in the order of arrival: every
/// number between the first and the last of a segment that never came. Segments are a sender's
/// runs, see divide_into_runs(); what was lost from one to the next is not known. (Losses before
/// the first and after the last arrival cannot be seen.) Lost packets get times between their
/// neighbours'.
///
/// A sender is taken for periodic if the median of its intervals, per sequence number, and three
/// quarters of them are within 25 % of the mean interval: arrival times, which delays disturb, are
/// then replaced by the sequence number times the mean interval.
FateLog fates_from_receptions(const std::vector<Reception>& receptions);

/// The same where the fates are known: completes the log's interval and periodicity from the times
/// of `packets`, which are in the order of sending.
FateLog fates_from_packets(std::vector<LoggedPacket> packets);

}  // namespace tether
