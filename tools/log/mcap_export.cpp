#include "tools/log/mcap_export.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "common/base/text.hpp"
#include "common/ros2/ros2_messages.hpp"
#include "tools/log/foxglove_schemas.hpp"
#include "tools/log/ros2_conversion.hpp"
#include "tools/log/scene_view.hpp"
#include "tools/messages/message_json.hpp"
#include "tools/messages/message_schema.hpp"

namespace tether {
namespace {

// Damaged records may say anything: times stay where 64 bits hold them in nanoseconds.
constexpr std::int64_t kLatest_us = INT64_MAX / 1000;
constexpr std::int64_t kEarliest_us = -1'000'000'000'000'000;  // 31 years before 0

/// MCAP's times are not negative: whole seconds that make the earliest so.
std::int64_t shift_of(const LogSurvey& survey) {
  constexpr std::int64_t kSecond_us = 1'000'000;
  const std::int64_t earliest_us = std::max(survey.earliest_us, kEarliest_us);
  return earliest_us >= 0 ? 0 : (-(earliest_us + 1) / kSecond_us + 1) * kSecond_us;
}

std::uint64_t shifted_ns(std::int64_t time_us, std::int64_t shift_us) {
  const std::int64_t us = std::clamp(time_us, kEarliest_us, kLatest_us) + shift_us;
  return static_cast<std::uint64_t>(std::clamp<std::int64_t>(us, 0, kLatest_us)) * 1000;
}

/// When, and with which number: what all that one event becomes has in common.
struct Stamp {
  std::uint64_t time_ns = 0;
  std::uint32_t sequence = 0;
};

/// The file's channels, made when they are first needed.
class Channels {
 public:
  explicit Channels(McapWriter& writer) : writer_(writer) {}

  /// False if there is no room for another channel. `schema()` returns the schema's text.
  template <class Schema>
  bool write(std::string_view topic, std::string_view schema_name, Schema schema,
             std::string_view data, const Stamp& stamp) {
    const auto channel = find(topic, schema_name, schema);
    if (!channel) return false;
    writer_.write({*channel, stamp.sequence, stamp.time_ns, stamp.time_ns, data});
    return true;
  }

  // Encodings, set once.
  std::string_view schema_encoding = "jsonschema", message_encoding = "json";
  McapWriter::Texts metadata;

 private:
  using Key = std::pair<std::string_view, std::string_view>;
  struct Less {
    using is_transparent = void;
    template <class A, class B>
    bool operator()(const A& a, const B& b) const {
      return Key(a.first, a.second) < Key(b.first, b.second);
    }
  };

  template <class Schema>
  std::optional<std::uint16_t> find(std::string_view topic, std::string_view schema_name,
                                    Schema schema) {
    const auto known = channels_.find(Key(topic, schema_name));
    if (known != channels_.end()) return known->second;
    if (channels_.size() >= LogSurvey::kMostChannels) return std::nullopt;
    auto numbered = schemas_.find(schema_name);
    if (numbered == schemas_.end()) {
      const std::uint16_t number = writer_.add_schema(schema_name, schema_encoding, schema());
      numbered = schemas_.emplace(schema_name, number).first;
    }
    const std::uint16_t channel =
        writer_.add_channel(numbered->second, printable(topic), message_encoding, metadata);
    channels_.emplace(std::pair<std::string, std::string>(topic, schema_name), channel);
    return channel;
  }

  McapWriter& writer_;
  std::map<std::pair<std::string, std::string>, std::uint16_t, Less> channels_;
  std::map<std::string, std::uint16_t, std::less<>> schemas_;
};

constexpr char kNoRoom[] = "beyond the first 1000 channels";

/// One message of the log at a time; says why one cannot be converted.
class Converter {
 public:
  Converter() = default;
  Converter(const Converter&) = delete;
  Converter& operator=(const Converter&) = delete;
  virtual ~Converter() = default;
  virtual std::string take(const LoggedEvent& event, const MessageContent& message,
                           const Stamp& stamp) = 0;
};

class JsonConverter final : public Converter {
 public:
  JsonConverter(Channels& channels, const SceneSetting& setting)
      : channels_(channels), view_(setting) {}

  std::string take(const LoggedEvent& event, const MessageContent& message,
                   const Stamp& stamp) override {
    json_.clear();
    append_message_json(json_, message);
    const auto schema = [&] { return json_schema(*message.type); };
    if (!channels_.write(event.channel, schema_name(*message.type), schema, json_, stamp)) {
      return kNoRoom;
    }
    seen_.clear();
    view_.on_message(event.channel, message, static_cast<std::int64_t>(stamp.time_ns), seen_);
    for (const ViewMessage& view : seen_) {
      const auto view_schema = [&] {
        return std::ranges::find(foxglove_schemas(), view.schema, &FoxgloveSchema::name)
            ->json_schema;
      };
      channels_.write(view.channel, view.schema, view_schema, view.json, stamp);
    }
    return "";
  }

 private:
  Channels& channels_;
  SceneView view_;
  std::string json_;
  std::vector<ViewMessage> seen_;
};

class RosConverter final : public Converter {
 public:
  RosConverter(Channels& channels, const LogSurvey& survey, std::int64_t shift_us,
               const std::vector<TimedPoint>& path)
      : channels_(channels), conversion_(survey.channels, shift_us * 1000) {
    channels_.schema_encoding = "ros2msg";
    channels_.message_encoding = "cdr";
    channels_.metadata = {{"offered_qos_profiles", ""}};  // rosbag2 then offers its default
    if (path.empty()) return;
    write(conversion_.plan(path), {shifted_ns(survey.earliest_us, shift_us), 0});
  }

  std::string take(const LoggedEvent& event, const MessageContent& message,
                   const Stamp& stamp) override {
    made_.clear();
    if (!conversion_.convert(event.channel, message, made_)) {
      return message.type->name + ", which has no counterpart in ROS 2";
    }
    for (const RosMessage& made : made_) {
      if (!write(made, stamp)) return kNoRoom;
    }
    return "";
  }

 private:
  bool write(const RosMessage& made, const Stamp& stamp) {
    const auto schema = [&] { return ros2_schema(made.type); };
    return channels_.write(made.topic, made.type, schema, made.cdr, stamp);
  }

  Channels& channels_;
  RosConversion conversion_;
  std::vector<RosMessage> made_;
};

void add_remarks(McapWriter& writer, const McapExportReport& report) {
  McapWriter::Texts remarks = {
      {"events", fmt::format("{}", report.events)},
      {"left_out", fmt::format("{}", report.left_out.count())},
      {"damaged_places", fmt::format("{}", report.damage.size())},
      {"time_shift_s", fmt::format("{}", report.shift_us / 1'000'000)},
  };
  writer.add_metadata("tether", remarks);
}

}  // namespace

McapExportReport export_mcap(EventLogReader& log, const LogSurvey& survey,
                             const McapExport& options, const McapWriter::Sink& sink) {
  McapExportReport report;
  report.shift_us = shift_of(survey);
  McapWriter writer({options.ros2 ? "ros2" : "", options.library}, sink);
  Channels channels(writer);
  std::unique_ptr<Converter> converter;
  if (options.ros2) {
    converter =
        std::make_unique<RosConverter>(channels, survey, report.shift_us, options.setting.path);
  } else {
    converter = std::make_unique<JsonConverter>(channels, options.setting);
  }

  LoggedEvent event;
  while (log.next(event)) {
    ++report.events;
    const MessageContent message = inspect_message(event.data);
    std::string why = why_unusable(message);
    if (why.empty()) {
      const auto seq = static_cast<std::uint32_t>(message.integer("seq").value_or(0));
      why = converter->take(event, message, {shifted_ns(event.timestamp_us, report.shift_us), seq});
    }
    if (why.empty()) {
      ++report.converted;
    } else {
      report.left_out.add(event.channel, why);
    }
  }
  report.damage = log.damage();
  add_remarks(writer, report);
  writer.finish();
  report.messages = writer.message_count();
  report.bytes = writer.byte_count();
  return report;
}

}  // namespace tether
