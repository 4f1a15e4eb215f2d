#include "tools/messages/message_printer.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tether/channel_setting_result_t.hpp>
#include <tether/channel_setting_t.hpp>
#include <tether/clock_t.hpp>
#include <tether/controller_report_t.hpp>
#include <tether/counters_t.hpp>
#include <tether/drive_fault_t.hpp>
#include <tether/drive_request_t.hpp>
#include <tether/drivetrain_state_t.hpp>
#include <tether/ground_truth_t.hpp>
#include <tether/link_report_t.hpp>
#include <tether/odometry_t.hpp>
#include <tether/plan_in_force_t.hpp>
#include <tether/plan_t.hpp>
#include <tether/pose_t.hpp>
#include <tether/time_grant_t.hpp>
#include <tether/time_join_t.hpp>
#include <tether/time_request_t.hpp>
#include <tether/time_resend_t.hpp>
#include <tether/time_welcome_t.hpp>
#include <tether/twist_t.hpp>
#include <tether/wheel_feedback_t.hpp>
#include <tether/wheel_states_t.hpp>
#include <tether/wheel_targets_t.hpp>
#include <type_traits>
#include <utility>

#include "common/bus/message_io.hpp"

namespace tether {
namespace {

// The fields of each type, in the order of its .lcm file. A new type needs one function here and
// one line in message_types(); tests/tools/messages/message_printer_test.cpp compares them with the
// .lcm files.
#define FIELD(name) visit(#name, m.name)

template <class Visitor>
void visit_fields(const pose_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(x_m), FIELD(y_m), FIELD(yaw_rad), FIELD(plan_session);
  FIELD(plan_id);
}

template <class Visitor>
void visit_fields(const twist_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(pose_utime), FIELD(v_mps), FIELD(omega_radps);
}

template <class Visitor>
void visit_fields(const plan_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(session), FIELD(id), FIELD(based_on);
  FIELD(based_on_last), FIELD(pose_utime), FIELD(start_utime), FIELD(settled_utime);
  FIELD(step_us), FIELD(count), FIELD(v_mps), FIELD(omega_radps);
}

template <class Visitor>
void visit_fields(const plan_in_force_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(session), FIELD(id);
}

template <class Visitor>
void visit_fields(const clock_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(rate);
}

template <class Visitor>
void visit_fields(const ground_truth_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(x_m), FIELD(y_m), FIELD(yaw_rad), FIELD(v_mps);
  FIELD(omega_radps), FIELD(left_rim_mps), FIELD(right_rim_mps), FIELD(x_ref_m), FIELD(y_ref_m);
  FIELD(error_m), FIELD(epsilon_m), FIELD(rmse_m), FIELD(max_error_m), FIELD(wall_contact_s);
  FIELD(wall_contact);
}

template <class Visitor>
void visit_fields(const link_report_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(link), FIELD(state), FIELD(state_prr), FIELD(state_delay_ms);
  FIELD(offered), FIELD(lost), FIELD(overflowed), FIELD(delivered), FIELD(in_flight);
  FIELD(delivered_bytes), FIELD(delay_ms_mean), FIELD(delay_ms_p50), FIELD(delay_ms_p90);
  FIELD(delay_ms_p99), FIELD(delay_ms_max);
}

template <class Visitor>
void visit_fields(const controller_report_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(pose_utime), FIELD(pose_seq), FIELD(pose_age_s);
  FIELD(heading_error_rad), FIELD(distance_error_m), FIELD(v_mps), FIELD(omega_radps);
  FIELD(pose_timed_out);
}

template <class Visitor>
void visit_fields(const counters_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(node), FIELD(count), FIELD(name), FIELD(value);
}

template <class Visitor>
void visit_fields(const drive_request_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(request);
}

template <class Visitor>
void visit_fields(const drivetrain_state_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(state), FIELD(state_name), FIELD(reason), FIELD(bus),
      FIELD(command_age_s), FIELD(v_mps), FIELD(omega_radps), FIELD(disarms);
}

template <class Visitor>
void visit_fields(const wheel_feedback_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(fresh), FIELD(left_age_s), FIELD(right_age_s),
      FIELD(left_angle_rad), FIELD(right_angle_rad), FIELD(left_rim_mps), FIELD(right_rim_mps),
      FIELD(left_position_counts), FIELD(right_position_counts), FIELD(left_statusword),
      FIELD(right_statusword), FIELD(left_error_code), FIELD(right_error_code), FIELD(left_state),
      FIELD(right_state);
}

template <class Visitor>
void visit_fields(const odometry_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(x_m), FIELD(y_m), FIELD(yaw_rad), FIELD(v_mps),
      FIELD(omega_radps), FIELD(distance_m);
}

template <class Visitor>
void visit_fields(const wheel_states_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(left_angle_rad), FIELD(right_angle_rad), FIELD(left_speed_radps),
      FIELD(right_speed_radps);
}

template <class Visitor>
void visit_fields(const wheel_targets_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(left_speed_radps), FIELD(right_speed_radps);
}

template <class Visitor>
void visit_fields(const drive_fault_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(node), FIELD(kind), FIELD(value);
}

template <class Visitor>
void visit_fields(const channel_setting_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(count), FIELD(key), FIELD(value);
}

template <class Visitor>
void visit_fields(const channel_setting_result_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(request_utime), FIELD(request_seq), FIELD(applied), FIELD(reason);
  FIELD(count), FIELD(key), FIELD(value);
}

template <class Visitor>
void visit_fields(const time_join_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(session), FIELD(instance), FIELD(node), FIELD(next_ns),
      FIELD(next_order), FIELD(count);
  FIELD(subscription);
}

template <class Visitor>
void visit_fields(const time_welcome_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(session), FIELD(instance), FIELD(node), FIELD(rank), FIELD(count),
      FIELD(subscription);
}

template <class Visitor>
void visit_fields(const time_grant_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(session), FIELD(id), FIELD(node), FIELD(kind), FIELD(until_ns),
      FIELD(until_order);
  FIELD(until_rank), FIELD(count), FIELD(publisher), FIELD(channel), FIELD(number), FIELD(time_ns);
  FIELD(order), FIELD(size), FIELD(crc32);
}

template <class Visitor>
void visit_fields(const time_request_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(session), FIELD(instance), FIELD(grant), FIELD(node),
      FIELD(next_ns), FIELD(next_order);
  FIELD(error), FIELD(count), FIELD(channel), FIELD(number), FIELD(time_ns), FIELD(index);
  FIELD(size), FIELD(crc32);
}

template <class Visitor>
void visit_fields(const time_resend_t& m, Visitor&& visit) {
  FIELD(utime), FIELD(seq), FIELD(session), FIELD(publisher), FIELD(channel), FIELD(number);
}

#undef FIELD

// LCM's booleans are int8_t in C++; none of the project's types has an int8_t of another meaning.
template <class T>
FieldValue to_value(const T& x) {
  if constexpr (std::is_same_v<T, std::int8_t>) {
    return x != 0;
  } else if constexpr (std::is_integral_v<T>) {
    return std::int64_t{x};
  } else {
    return x;
  }
}

template <class LcmType>
std::optional<std::vector<FieldValue>> decode_values(std::span<const std::uint8_t> bytes) {
  LcmType message{};
  if (!decode(bytes, message)) return std::nullopt;
  std::vector<FieldValue> values;
  visit_fields(message, [&](const char*, const auto& x) { values.push_back(to_value(x)); });
  return values;
}

template <class LcmType>
MessageType describe() {
  MessageType type{LcmType::getTypeName(), LcmType::getHash(), {}, &decode_values<LcmType>};
  visit_fields(LcmType{},
               [&](const char* name, const auto&) { type.field_names.emplace_back(name); });
  return type;
}

struct LineFormat {
  std::string operator()(std::int64_t x) const { return fmt::format("{}", x); }
  std::string operator()(double x) const { return fmt::format("{}", x); }
  std::string operator()(float x) const { return fmt::format("{}", x); }
  std::string operator()(bool x) const { return x ? "true" : "false"; }
  std::string operator()(const std::string& x) const { return printable(x); }
  template <class T>
  std::string operator()(const std::vector<T>& list) const {
    std::vector<std::string> parts;
    for (const T& x : list) parts.push_back((*this)(x));
    return fmt::format("[{}]", fmt::join(parts, ", "));
  }
};

struct CsvFormat {
  std::string operator()(std::int64_t x) const { return fmt::format("{}", x); }
  std::string operator()(double x) const { return fmt::format("{}", x); }
  std::string operator()(bool x) const { return x ? "1" : "0"; }
  std::string operator()(const std::string& x) const {
    if (x.find_first_of(",\"\r\n") == std::string::npos) return x;
    std::string quoted = "\"";
    for (const char c : x) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
    return quoted + '"';
  }
  template <class T>
  std::string operator()(const std::vector<T>& list) const {
    return (*this)(fmt::format("{}", fmt::join(list, ";")));
  }
};

}  // namespace

const std::vector<MessageType>& message_types() {
  static const std::vector<MessageType> kTypes = {
      describe<pose_t>(),
      describe<twist_t>(),
      describe<plan_t>(),
      describe<plan_in_force_t>(),
      describe<clock_t>(),
      describe<ground_truth_t>(),
      describe<link_report_t>(),
      describe<controller_report_t>(),
      describe<counters_t>(),
      describe<drive_request_t>(),
      describe<drivetrain_state_t>(),
      describe<wheel_feedback_t>(),
      describe<odometry_t>(),
      describe<wheel_states_t>(),
      describe<wheel_targets_t>(),
      describe<drive_fault_t>(),
      describe<channel_setting_t>(),
      describe<channel_setting_result_t>(),
      describe<time_join_t>(),
      describe<time_welcome_t>(),
      describe<time_grant_t>(),
      describe<time_request_t>(),
      describe<time_resend_t>(),
  };
  return kTypes;
}

const MessageType* find_message_type(std::int64_t fingerprint) {
  for (const MessageType& type : message_types()) {
    if (type.fingerprint == fingerprint) return &type;
  }
  return nullptr;
}

std::optional<std::int64_t> MessageContent::integer(std::string_view field_name) const {
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (type->field_names[i] != field_name) continue;
    if (const auto* value = std::get_if<std::int64_t>(&values[i])) return *value;
  }
  return std::nullopt;
}

MessageContent inspect_message(std::span<const std::uint8_t> bytes) {
  MessageContent content;
  content.size_bytes = bytes.size();
  if (bytes.size() < 8) return content;
  std::uint64_t fingerprint = 0;
  for (const std::uint8_t byte : bytes.first(8)) fingerprint = fingerprint << 8 | byte;
  content.fingerprint = static_cast<std::int64_t>(fingerprint);
  content.type = find_message_type(*content.fingerprint);
  if (content.type != nullptr) {
    if (auto values = content.type->decode(bytes)) content.values = std::move(*values);
  }
  return content;
}

std::string type_label(const MessageContent& message) {
  if (message.type != nullptr) return message.type->name;
  if (!message.fingerprint) return "-";
  return fmt::format("0x{:016x}", static_cast<std::uint64_t>(*message.fingerprint));
}

std::string format_message(std::string_view channel, const MessageContent& message) {
  std::string line = fmt::format("{} {}", printable(channel), type_label(message));
  if (!message.decoded()) {
    return line + fmt::format(" ({}, {} bytes)",
                              message.type != nullptr ? "undecodable" : "unknown type",
                              message.size_bytes);
  }
  for (std::size_t i = 0; i < message.values.size(); ++i) {
    line += fmt::format(" {}={}", message.type->field_names[i],
                        std::visit(LineFormat{}, message.values[i]));
  }
  return line;
}

std::string csv_names(const MessageType& type) {
  return fmt::format("{}", fmt::join(type.field_names, ","));
}

std::string csv_values(const std::vector<FieldValue>& values) {
  std::vector<std::string> cells;
  for (const FieldValue& value : values) cells.push_back(std::visit(CsvFormat{}, value));
  return fmt::format("{}", fmt::join(cells, ","));
}

std::string printable(std::string_view text) {
  std::string safe;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte >= 0x20 && byte < 0x7f) {
      safe += c;
    } else {
      safe += fmt::format("\\x{:02x}", byte);
    }
  }
  return safe;
}

}  // namespace tether
