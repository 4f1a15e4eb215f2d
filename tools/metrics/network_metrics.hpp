#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <string_view>

#include "common/base/counters.hpp"
#include "common/base/time.hpp"
#include "tools/messages/message_printer.hpp"
#include "tools/messages/stream_statistics.hpp"

namespace tether {

/// Metrics of the programs on an LCM network, from its messages, in Prometheus' text format
/// (version 0.0.4).
///
/// A value that was never reported is absent. A reported value stays, and the age of its report is
/// beside it; ages in reports (of a command, a pose, a datagram) grow while no newer report comes.
/// No two samples have the same name and labels, whatever is received.
class NetworkMetrics {
 public:
  /// Anybody on the network can invent channels: messages of further ones are only counted.
  static constexpr std::size_t kMaxChannels = 1000;
  /// The same limit for peers, nodes and vehicles.
  static constexpr std::size_t kMaxReports = 1000;
  static constexpr const char* kMediaType = "text/plain; version=0.0.4; charset=utf-8";

  /// `now` must not decrease.
  void on_message(Instant now, std::string_view channel, std::span<const std::uint8_t> bytes);

  /// `network`: what the bus counts (Bus::list_counters).
  std::string text(Instant now, const CounterList& network) const;

 private:
  struct Channel {
    Instant heard;
    std::int64_t messages = 0;
    SequenceCounter sequence;
  };
  struct Report {
    std::string labels;
    MessageContent message;
    Instant heard;
  };

  void append_rows(Instant now, std::string& text) const;

  std::map<std::string, Channel, std::less<>> channels_;
  /// By type and labels.
  std::map<std::string, Report, std::less<>> reports_;
  std::int64_t beyond_limit_ = 0;
};

}  // namespace tether
