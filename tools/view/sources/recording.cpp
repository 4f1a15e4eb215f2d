#include "tools/view/sources/recording.hpp"

#include <fmt/format.h>

#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "tools/base/json.hpp"
#include "tools/messages/message_json.hpp"
#include "tools/messages/message_schema.hpp"
#include "tools/view/sources/run_json.hpp"

namespace tether {
namespace {

using Json = nlohmann::ordered_json;

std::string about(const ViewedLog& log, double start_s, double end_s) {
  RunDescription run{.kind = "log",
                     .source = std::filesystem::path(log.file()).filename().string(),
                     .notes = log.notes()};
  if (log.scenario()) run.take(*log.scenario());
  run.parameters = playback_descriptions(start_s, end_s, true);
  return run_json(run);
}

/// Numbers for channels; one whose messages change their type has two.
class Channels {
 public:
  /// -1 if there are too many.
  int number(const std::string& topic, const MessageType& type) {
    const auto [found, is_new] =
        numbers_.try_emplace({topic, &type}, static_cast<int>(numbers_.size()));
    if (!is_new) return found->second;
    if (numbers_.size() > LogSurvey::kMostChannels) {
      numbers_.erase(found);
      return -1;
    }
    list_.push_back({{"id", found->second}, {"topic", topic}, {"schemaName", schema_name(type)}});
    return found->second;
  }
  const Json& list() const { return list_; }

 private:
  std::map<std::pair<std::string, const MessageType*>, int> numbers_;
  Json list_ = Json::array();
};

}  // namespace

Recording record(ViewedLog& log, const RecordedSpan& span, std::size_t most_bytes) {
  Recording recording;
  Channels channels;
  std::string lines;
  double start_s = 0.0, end_s = 0.0;
  for (const LogIndex::Entry& entry : log.index().entries()) {
    const double t_s = to_seconds(entry.time - log.zero());
    if (t_s < span.from_s || t_s > span.to_s) continue;
    const std::string& topic = log.index().channel(entry);
    const MessageContent message = inspect_message(log.read(entry));
    const std::string why = why_unusable(message);
    const int channel = why.empty() ? channels.number(topic, *message.type) : -1;
    if (channel < 0) {
      recording.left_out.add(topic, why.empty() ? "beyond the first 1000 channels" : why);
      continue;
    }
    if (recording.messages++ == 0) start_s = t_s;
    end_s = t_s;
    fmt::format_to(std::back_inserter(lines), "{} {} ", to_utime(entry.time), channel);
    append_message_json(lines, message);
    lines += '\n';
    if (lines.size() > most_bytes) {
      throw UsageError(fmt::format(
          "{}: up to {:.1f} s it has more than {} MiB of messages, too many for one file: name a "
          "part by --from and --to, or use tether view, which plays any length",
          log.file(), t_s, most_bytes >> 20));
    }
  }
  if (recording.messages == 0) {
    throw UsageError(
        fmt::format("{}, from {} s to {} s: in the part that is asked for there is no message of a "
                    "type that Tether knows",
                    log.file(), log.start_s(), log.end_s()));
  }
  const auto name = std::filesystem::path(log.file()).filename().string();
  const Json header = {{"title", "tether: " + name},
                       {"zero_us", to_utime(log.zero())},
                       {"count", recording.messages},
                       {"channels", channels.list()},
                       {"about", parse_ordered_json(about(log, start_s, end_s))}};
  recording.text = json_text(header) + '\n' + lines;
  return recording;
}

}  // namespace tether
