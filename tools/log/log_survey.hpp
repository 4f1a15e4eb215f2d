#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "tools/messages/event_log.hpp"
#include "tools/messages/message_printer.hpp"

namespace tether {

/// Facts on a log that are needed before its first message can be converted.
struct LogSurvey {
  /// Maximum number of channels; an export leaves out the rest: anybody on the network can invent
  /// them.
  static constexpr std::size_t kMostChannels = 1000;

  std::int64_t events = 0;
  std::int64_t earliest_us = 0;
  std::set<std::string> channels;  ///< with a message that can be decoded
};

/// Reads to the end.
LogSurvey survey_log(EventLogReader& log);

/// Messages that an export left out, by channel and reason, and skipped bytes.
class LeftOut {
 public:
  void add(std::string_view channel, const std::string& reason);
  std::int64_t count() const { return count_; }
  /// One line for each channel and reason: "5 messages on X: of an unknown type"; after twenty, how
  /// many more there are.
  std::vector<std::string> lines() const;

 private:
  std::map<std::pair<std::string, std::string>, std::int64_t> counts_;
  std::int64_t count_ = 0;
  std::int64_t beyond_ = 0;  // number of further channels
};

/// Why a message cannot be converted at all; empty if it can.
std::string why_unusable(const MessageContent& message);

}  // namespace tether
