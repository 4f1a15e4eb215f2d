#include "tools/log/log_survey.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "common/base/text.hpp"

namespace tether {

LogSurvey survey_log(EventLogReader& log) {
  LogSurvey survey;
  LoggedEvent event;
  while (log.next(event)) {
    survey.earliest_us =
        survey.events == 0 ? event.timestamp_us : std::min(survey.earliest_us, event.timestamp_us);
    ++survey.events;
    if (survey.channels.size() >= LogSurvey::kMostChannels ||
        survey.channels.contains(event.channel)) {
      continue;
    }
    if (inspect_message(event.data).decoded()) survey.channels.insert(event.channel);
  }
  return survey;
}

void LeftOut::add(std::string_view channel, const std::string& reason) {
  ++count_;
  const std::pair key{printable(channel), reason};
  if (!counts_.contains(key) && counts_.size() >= LogSurvey::kMostChannels) {
    ++beyond_;
  } else {
    ++counts_[key];
  }
}

std::vector<std::string> LeftOut::lines() const {
  constexpr std::size_t kShown = 20;
  std::vector<std::string> lines;
  std::int64_t more = beyond_;
  for (const auto& [key, count] : counts_) {
    const auto& [channel, reason] = key;
    if (lines.size() < kShown) {
      lines.push_back(
          fmt::format("{} message{} on {}: {}", count, count == 1 ? "" : "s", channel, reason));
    } else {
      more += count;
    }
  }
  if (more > 0) lines.push_back(fmt::format("{} more", more));
  return lines;
}

std::string why_unusable(const MessageContent& message) {
  if (message.decoded()) return "";
  if (message.type != nullptr) return "a " + message.type->name + " that cannot be decoded";
  return fmt::format("of an unknown type ({})", type_label(message));
}

}  // namespace tether
