#include "tools/metrics/network_metrics.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <variant>
#include <vector>

#include "common/base/text.hpp"
#include "common/node/channel_names.hpp"
#include "common/version.hpp"

namespace tether {
namespace {

std::string label(std::string_view name, std::string_view value) {
  return fmt::format("{}={}", name, in_quotes(printable(value, kLongestNameShown)));
}

std::string number_text(double value) {
  if (std::isnan(value)) return "NaN";
  if (std::isinf(value)) return value > 0 ? "+Inf" : "-Inf";
  return fmt::format("{}", value);
}
std::string number_text(std::int64_t value) { return fmt::format("{}", value); }

/// Samples of one name, below its HELP and TYPE. Of two with the same labels, the first counts.
class Family {
 public:
  Family(std::string_view name, std::string_view type, std::string_view help)
      : name_(name), type_(type), help_(help) {}

  template <class Number>
  void add(const std::string& labels, Number value) {
    samples_.emplace(labels, number_text(value));
  }
  void append_to(std::string& text) const {
    if (samples_.empty()) return;
    text += fmt::format("# HELP {} {}\n# TYPE {} {}\n", name_, help_, name_, type_);
    for (const auto& [labels, value] : samples_) {
      text += labels.empty() ? fmt::format("{} {}\n", name_, value)
                             : fmt::format("{}{{{}}} {}\n", name_, labels, value);
    }
  }

 private:
  std::string_view name_, type_, help_;
  std::map<std::string, std::string> samples_;
};

enum class Kind : std::uint8_t {
  counter,
  gauge,
  age,   ///< seconds; negative: unknown; grows until the next report
  text,  ///< the field is a label of its own name, and the value 1
};

/// One field of a report, of which an array has an element for each path.
struct Row {
  const char* type;
  const char* field;
  Kind kind;
  const char* name;
  const char* help;
  double scale = 1.0;
  /// The field that says whether this one means anything: true, or not negative.
  const char* known_by = nullptr;
};

constexpr double kMilli = 1e-3;
constexpr char kPeer[] = "peer_report_t", kBridge[] = "drivetrain_state_t",
               kController[] = "controller_report_t", kRelay[] = "link_report_t",
               kCounters[] = "counters_t";

// clang-format off
constexpr auto kRows = std::to_array<Row>({
  {kPeer, "up", Kind::gauge, "tether_link_up", "1 if authentic datagrams of the peer arrive, by one path at least."},
  {kPeer, "age_s", Kind::age, "tether_link_age_seconds", "Time since the peer's newest authentic datagram."},
  {kPeer, "sessions", Kind::counter, "tether_link_sessions_total", "Completed handshakes."},
  {kPeer, "offset_min_ms", Kind::gauge, "tether_link_clock_offset_min_seconds", "The peer's clock is ahead of this host's by at least this.", kMilli, "offset_known"},
  {kPeer, "offset_max_ms", Kind::gauge, "tether_link_clock_offset_max_seconds", "The peer's clock is ahead of this host's by at most this.", kMilli, "offset_known"},
  {kPeer, "clocks_apart", Kind::gauge, "tether_link_clocks_apart", "1 if the clocks differ by clock_warning_ms at least."},
  {kPeer, "clock_steps", Kind::counter, "tether_link_clock_steps_total", "How often a clock was set."},
  {kPeer, "clock_refused", Kind::counter, "tether_link_clock_refused_total", "Messages for a time that were refused because the clocks are too far apart."},
  {kPeer, "sent", Kind::counter, "tether_link_messages_sent_total", "Messages to the peer."},
  {kPeer, "unsent", Kind::counter, "tether_link_messages_unsent_total", "Messages that were not sent: no session, or too long."},
  {kPeer, "delivered", Kind::counter, "tether_link_messages_delivered_total", "Messages of the peer, each once."},
  {kPeer, "not_allowed", Kind::counter, "tether_link_messages_not_allowed_total", "Messages of channels that the peer may not send."},
  {kPeer, "superseded", Kind::counter, "tether_link_messages_superseded_total", "Messages of latest-only channels that came after a newer one."},
  {kPeer, "incomplete", Kind::counter, "tether_link_messages_incomplete_total", "Messages of which pieces are missing."},
  {kPeer, "duplicates", Kind::counter, "tether_link_datagrams_duplicate_total", "Datagrams that came by several paths."},
  {kPeer, "path_alive", Kind::gauge, "tether_link_path_up", "1 if authentic datagrams arrive by this path."},
  {kPeer, "path_age_s", Kind::age, "tether_link_path_age_seconds", "Time since the newest authentic datagram by this path."},
  {kPeer, "path_gap_s", Kind::gauge, "tether_link_path_gap_seconds", "Longest time between two datagrams by this path, since the report before."},
  {kPeer, "path_sent", Kind::counter, "tether_link_path_datagrams_sent_total", "Datagrams sent by this path."},
  {kPeer, "path_unsent", Kind::counter, "tether_link_path_datagrams_unsent_total", "Datagrams that this host's system did not send."},
  {kPeer, "path_dropped", Kind::counter, "tether_link_path_datagrams_dropped_total", "Datagrams that this host's system dropped for lack of room."},
  {kPeer, "path_received", Kind::counter, "tether_link_path_datagrams_received_total", "Authentic datagrams received by this path."},
  {kPeer, "path_first", Kind::counter, "tether_link_path_datagrams_first_total", "Datagrams that no other path had brought before."},
  {kPeer, "path_lost", Kind::counter, "tether_link_path_datagrams_lost_total", "Datagrams of the peer that did not come by this path."},
  {kPeer, "path_loss", Kind::gauge, "tether_link_path_loss_ratio", "Share of the peer's datagrams lost on this path, over 5 s.", 1.0, "path_loss"},
  {kPeer, "path_delay_min_ms", Kind::gauge, "tether_link_path_delay_min_seconds", "Mean delay from the peer since the report before is at least this.", kMilli, "path_delay_max_ms"},
  {kPeer, "path_delay_max_ms", Kind::gauge, "tether_link_path_delay_max_seconds", "Mean delay from the peer since the report before is at most this.", kMilli, "path_delay_max_ms"},
  {kPeer, "path_worst_min_ms", Kind::gauge, "tether_link_path_delay_worst_min_seconds", "Longest delay since the report before is at least this.", kMilli, "path_delay_max_ms"},
  {kPeer, "path_worst_max_ms", Kind::gauge, "tether_link_path_delay_worst_max_seconds", "Longest delay since the report before is at most this.", kMilli, "path_delay_max_ms"},
  {kPeer, "path_round_trip_ms", Kind::gauge, "tether_link_path_round_trip_seconds", "Shortest round trip since the report before.", kMilli, "path_round_trip_ms"},

  {kBridge, "state_name", Kind::text, "tether_drivetrain_state", "1, for the CAN bridge's state."},
  {kBridge, "bus", Kind::text, "tether_drivetrain_bus", "1, for the state of the CAN bus."},
  {kBridge, "command_age_s", Kind::age, "tether_drivetrain_command_age_seconds", "Time since the newest accepted command."},
  {kBridge, "v_mps", Kind::gauge, "tether_drivetrain_speed_setpoint_meters_per_second", "Forward speed in force after all limits."},
  {kBridge, "omega_radps", Kind::gauge, "tether_drivetrain_yaw_rate_setpoint_radians_per_second", "Yaw rate in force after all limits, left positive."},
  {kBridge, "disarms", Kind::counter, "tether_drivetrain_disarms_total", "How often an armed vehicle was stopped and disarmed."},

  {kController, "pose_age_s", Kind::age, "tether_controller_pose_age_seconds", "Age of the controller's newest pose: time since it was measured.", 1.0, "pose_seq"},
  {kController, "pose_timed_out", Kind::gauge, "tether_controller_pose_timed_out", "1 if the controller stops the vehicle because its newest pose is too old."},

  {kRelay, "offered", Kind::counter, "tether_relay_packets_offered_total", "Packets that arrived at the relay's link, and copies that it made."},
  {kRelay, "lost", Kind::counter, "tether_relay_packets_lost_total", "Packets that the channel dropped."},
  {kRelay, "overflowed", Kind::counter, "tether_relay_packets_overflowed_total", "Packets dropped because there was no room for them."},
  {kRelay, "delivered", Kind::counter, "tether_relay_packets_delivered_total", "Packets that left the relay's link."},
  {kRelay, "delivered_bytes", Kind::counter, "tether_relay_delivered_bytes_total", "Payload of the delivered packets."},
  {kRelay, "in_flight", Kind::gauge, "tether_relay_packets_in_flight", "Packets in the relay's queue."},
  {kRelay, "delay_ms_mean", Kind::gauge, "tether_relay_delay_mean_seconds", "Mean sojourn time of the delivered packets.", kMilli},
  {kRelay, "delay_ms_p99", Kind::gauge, "tether_relay_delay_p99_seconds", "99th percentile of the delivered packets' sojourn time.", kMilli},
});
// clang-format on

template <class Field>
const Field& field_of(const MessageContent& message, std::string_view name) {
  return std::get<Field>(*message.find(name));
}

/// Labels that distinguish its reports from others of its type; nothing if it is no report.
std::optional<std::string> labels_of(std::string_view channel, const MessageContent& message) {
  const std::string& type = message.type->name;
  if (type == kPeer) return label("peer", field_of<std::string>(message, "peer"));
  const std::string vehicle = label("vehicle", vehicle_of_channel(channel));
  if (type == kBridge || type == kController) return vehicle;
  if (type == kRelay) {
    return vehicle + "," + label("link", field_of<std::string>(message, "link"));
  }
  if (type == kCounters) {
    return vehicle + "," + label("node", field_of<std::string>(message, "node"));
  }
  return std::nullopt;
}

/// A number, or element `i` of numbers. Nothing for text.
std::optional<std::variant<std::int64_t, double>> number_in(const FieldValue& value,
                                                            std::size_t i) {
  if (const auto* x = std::get_if<std::int64_t>(&value)) return *x;
  if (const auto* x = std::get_if<double>(&value)) return *x;
  if (const auto* x = std::get_if<bool>(&value)) return std::int64_t{*x};
  if (const auto* all = std::get_if<std::vector<std::int64_t>>(&value)) return all->at(i);
  if (const auto* all = std::get_if<std::vector<double>>(&value)) return all->at(i);
  return std::nullopt;
}

double as_double(const std::variant<std::int64_t, double>& number) {
  return std::visit([](auto x) { return static_cast<double>(x); }, number);
}

bool is_array(const FieldValue& value) {
  return std::holds_alternative<std::vector<std::int64_t>>(value) ||
         std::holds_alternative<std::vector<double>>(value);
}

bool is_known(const Row& row, const MessageContent& message, std::size_t i) {
  if (row.known_by == nullptr) return true;
  const FieldValue& value = *message.find(row.known_by);
  if (const auto* truth = std::get_if<bool>(&value)) return *truth;
  return as_double(*number_in(value, i)) >= 0.0;
}

void add_number(const Row& row, const MessageContent& message, std::size_t i,
                const std::string& labels, double since_report_s, Family& family) {
  const auto number = *number_in(*message.find(row.field), i);
  if (!is_known(row, message, i)) return;
  if (row.kind == Kind::age) {
    if (as_double(number) >= 0.0) family.add(labels, as_double(number) + since_report_s);
  } else if (row.scale != 1.0) {
    family.add(labels, as_double(number) * row.scale);
  } else {
    std::visit([&](auto x) { family.add(labels, x); }, number);
  }
}

void add_row(const Row& row, const MessageContent& message, const std::string& labels,
             double since_report_s, Family& family) {
  const FieldValue& value = *message.find(row.field);
  if (row.kind == Kind::text) {
    family.add(labels + "," + label(row.field, std::get<std::string>(value)), std::int64_t{1});
  } else if (!is_array(value)) {
    add_number(row, message, 0, labels, since_report_s, family);
  } else {
    const auto& paths = field_of<std::vector<std::string>>(message, "path");
    for (std::size_t i = 0; i < paths.size(); ++i) {
      add_number(row, message, i, labels + "," + label("path", paths[i]), since_report_s, family);
    }
  }
}

}  // namespace

void NetworkMetrics::on_message(Instant now, std::string_view channel,
                                std::span<const std::uint8_t> bytes) {
  auto known = channels_.find(channel);
  if (known == channels_.end()) {
    if (channels_.size() == kMaxChannels) {
      ++beyond_limit_;
      return;
    }
    known = channels_.emplace(std::string(channel), Channel{}).first;
  }
  Channel& heard = known->second;
  heard.heard = now;
  ++heard.messages;
  MessageContent message = inspect_message(bytes);
  if (!message.decoded()) return;
  const auto utime = message.integer("utime"), seq = message.integer("seq");
  if (utime && seq) heard.sequence.on_message({*utime, *seq});
  const std::optional<std::string> labels = labels_of(channel, message);
  if (!labels) return;
  const std::string key = message.type->name + " " + *labels;
  if (!reports_.contains(key) && reports_.size() == kMaxReports) {
    ++beyond_limit_;
    return;
  }
  reports_.insert_or_assign(key, Report{*labels, std::move(message), now});
}

void NetworkMetrics::append_rows(Instant now, std::string& text) const {
  for (const Row& row : kRows) {
    Family family(row.name, row.kind == Kind::counter ? "counter" : "gauge", row.help);
    for (const auto& [key, report] : reports_) {
      if (report.message.type->name != row.type) continue;
      add_row(row, report.message, report.labels, to_seconds(now - report.heard), family);
    }
    family.append_to(text);
  }
}

std::string NetworkMetrics::text(Instant now, const CounterList& network) const {
  std::string text;
  append_rows(now, text);

  Family refused("tether_link_datagrams_refused_total", "counter",
                 "Datagrams that the link refused, of all peers and of unknown senders.");
  Family link_ages("tether_link_report_age_seconds", "gauge",
                   "Time since the link's newest report on this peer.");
  Family slips("tether_loop_slips_total", "counter",
               "Periodic tasks of the node that began later than one whole period.");
  Family events("tether_node_events_total", "counter", "What the node's named counters count.");
  for (const auto& [key, report] : reports_) {
    const MessageContent& message = report.message;
    if (message.type->name == kPeer) {
      link_ages.add(report.labels, to_seconds(now - report.heard));
      const auto& reasons = field_of<std::vector<std::string>>(message, "refused");
      const auto& counts = field_of<std::vector<std::int64_t>>(message, "refused_count");
      for (std::size_t i = 0; i < reasons.size(); ++i)
        refused.add(label("reason", reasons[i]), counts[i]);
    } else if (message.type->name == kCounters) {
      const auto& names = field_of<std::vector<std::string>>(message, "name");
      const auto& values = field_of<std::vector<std::int64_t>>(message, "value");
      for (std::size_t i = 0; i < names.size(); ++i) {
        if (names[i] == "loop.slips") {
          slips.add(report.labels, values[i]);
        } else {
          events.add(report.labels + "," + label("event", names[i]), values[i]);
        }
      }
    }
  }

  Family ages("tether_channel_age_seconds", "gauge", "Time since the channel's newest message.");
  Family messages("tether_channel_messages_total", "counter", "Messages heard on the channel.");
  Family missed("tether_channel_messages_missed_total", "counter",
                "Messages of the channel that were not heard, by their numbers.");
  for (const auto& [name, channel] : channels_) {
    const std::string labels = label("channel", name);
    ages.add(labels, to_seconds(now - channel.heard));
    messages.add(labels, channel.messages);
    missed.add(labels, channel.sequence.counters().missed);
  }

  Family ignored("tether_metrics_messages_ignored_total", "counter",
                 "Messages of channels or senders beyond what this program keeps.");
  ignored.add("", beyond_limit_);
  Family own("tether_metrics_network_events_total", "counter",
             "What went wrong while this program listened to LCM.");
  for (const auto& [name, count] : network) own.add(label("event", name), count);
  Family build("tether_build_info", "gauge", "1, for the version of this program.");
  build.add(label("version", kVersion), std::int64_t{1});
  for (const Family* family :
       std::to_array<const Family*>({&refused, &link_ages, &slips, &events, &ages, &messages,
                                     &missed, &ignored, &own, &build})) {
    family->append_to(text);
  }
  return text;
}

}  // namespace tether
