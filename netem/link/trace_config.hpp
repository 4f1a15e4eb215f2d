#pragma once

#include <optional>
#include <string>

namespace tether {

/// Recorded conditions: netem/models/trace.hpp has the file's format.
struct TraceConfig {
  enum class Interpolation { step, linear };
  enum class AtEnd { hold, loop };

  std::string file;
  /// step: a row holds until the next one; linear: PRR and delay move evenly from row to row.
  Interpolation interpolation = Interpolation::step;
  /// hold: the last row stays; loop: from the last row's time on, the trace begins again.
  AtEnd at_end = AtEnd::hold;
  std::optional<double> start_s;  ///< the trace's time at t = 0; unset: that of its first row

  bool operator==(const TraceConfig&) const = default;
};

}  // namespace tether
