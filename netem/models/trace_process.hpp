#pragma once

#include <memory>
#include <optional>
#include <string>

#include "netem/link/channel_process.hpp"
#include "netem/models/trace.hpp"

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

/// Conditions as recorded, a function of time only.
///
/// The trace's time at the run's start is config.start_s, or its first row's. Before its first row
/// the first row holds (at_end = loop: so does the end of the round before). at_end = loop repeats
/// all rows, of which the last lasts as long as the one before it: N rows, one a second, make a
/// round of N seconds.
///
/// interpolation = linear moves delay and PRR evenly between rows, also from the last of a round to
/// the first of the next; recorded fates (column "lost")
/// always hold until the next row. In a trace of single packets use step: a packet then gets the
/// fate of the latest packet recorded before it.
class TraceProcess final : public ChannelProcess {
 public:
  /// Throws UsageError, naming `key_prefix`, for a looped trace of one row.
  TraceProcess(std::shared_ptr<const Trace> trace, const TraceConfig& config,
               const std::string& key_prefix);

  void advance(Instant now) override;
  LinkCondition condition() const override { return condition_; }
  /// The row, from 0.
  int state() const override { return static_cast<int>(row_); }
  Instant next_transition() const override { return until_; }

 private:
  void find_row(Duration since_first);

  std::shared_ptr<const Trace> trace_;
  TraceConfig::Interpolation interpolation_;
  bool loop_;
  Duration round_{0};  // length of a loop
  Duration start_;     // since the first row, at t = 0
  Instant now_ = Instant::min();
  Instant until_ = Instant::max();
  std::size_t row_ = 0;
  LinkCondition condition_;
};

/// Reads config.file. Throws UsageError for what is wrong with it; `key_prefix`, such as
/// "channel.uplink.trace.", is for messages about keys.
std::shared_ptr<ChannelProcess> make_trace_process(const TraceConfig& config,
                                                   const std::string& key_prefix);

}  // namespace tether
