#pragma once

#include <cstdint>
#include <vector>

#include "netem/fit/data.hpp"

namespace tether {

/// The arrivals of a log, divided by the sender's runs.
struct ReceptionRuns {
  /// Each run's arrivals, in the order of arrival; copies and late ones are among them.
  std::vector<std::vector<Reception>> runs;
  /// Arrivals left out, because neither their run nor a new one explains their number and time.
  std::int64_t implausible = 0;
};

/// Believes a sequence number only if it fits the time that has passed since the ones before, as
/// RFC 3550 (appendix A.1) does by numbers alone. With h the median time per number (over
/// neighbours or over 64 arrivals, whichever is less) and a slack J of 2 s or 20 h, whichever is
/// more, an arrival
///
/// - goes on with the run if it is ahead by at most 1 + (3·elapsed + J)/h numbers. If it comes more
///   than J later than its number says, the sender made a pause; the next arrival must confirm it;
/// - is late, or a copy, if it is behind, and the run was past its number for at most J. But 16 in
///   a row that count up from 0 again, as fast as the sender, half of them already known, are no
///   copies: the sender restarted;
/// - begins a new run if two more arrivals go on from it, before any goes on with the old run;
/// - is implausible otherwise: its number or its time is damaged.
///
/// Without a time to tell (all the same), up to 1'000'000 ahead and 1000 behind are believed.
ReceptionRuns divide_into_runs(const std::vector<Reception>& receptions);

}  // namespace tether
