#include "tools/view/server/client_message.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>

#include "common/base/text.hpp"
#include "tools/base/json.hpp"

namespace tether {
namespace {

using Json = nlohmann::json;

/// Ends the parsing of a message; never leaves this file.
struct Nonsense {
  std::string reason;
};

const Json& member(const Json& object, const char* name) {
  const auto found = object.find(name);
  if (found == object.end()) throw Nonsense{fmt::format("\"{}\" is missing", name)};
  return *found;
}

std::uint32_t as_id(const Json& json, const char* name) {
  if (json.is_number_unsigned()) {
    const auto id = json.get<std::uint64_t>();
    if (id <= std::numeric_limits<std::uint32_t>::max()) return static_cast<std::uint32_t>(id);
  }
  throw Nonsense{fmt::format("\"{}\" has to be a whole number from 0 to 4294967295", name)};
}

std::string as_text(const Json& json, const char* name) {
  if (!json.is_string()) throw Nonsense{fmt::format("\"{}\" has to be a string", name)};
  auto text = json.get<std::string>();
  if (text.size() > kLongestClientName) {
    throw Nonsense{fmt::format("\"{}\" has more than {} bytes", name, kLongestClientName)};
  }
  return text;
}

/// Calls f(element) for each of the list `name`.
template <class Function>
void for_each_of(const Json& message, const char* name, Function f) {
  const Json& list = member(message, name);
  if (!list.is_array()) throw Nonsense{fmt::format("\"{}\" has to be a list", name)};
  if (list.size() > kMostClientElements) {
    throw Nonsense{fmt::format("\"{}\" has more than {} elements", name, kMostClientElements)};
  }
  for (const Json& element : list) f(element);
}

/// The same where each element is an object.
template <class Function>
void for_each_object_of(const Json& message, const char* name, Function f) {
  for_each_of(message, name, [&](const Json& element) {
    if (!element.is_object()) throw Nonsense{fmt::format("\"{}\" has to be of objects", name)};
    f(element);
  });
}

std::vector<std::uint32_t> ids(const Json& message, const char* name) {
  std::vector<std::uint32_t> all;
  for_each_of(message, name, [&](const Json& id) { all.push_back(as_id(id, name)); });
  return all;
}

std::vector<std::string> names(const Json& message) {
  std::vector<std::string> all;
  for_each_of(message, "parameterNames",
              [&](const Json& one) { all.push_back(as_text(one, "parameterNames")); });
  return all;
}

std::optional<std::string> request(const Json& message) {
  const auto found = message.find("id");
  if (found == message.end() || found->is_null()) return std::nullopt;
  return as_text(*found, "id");
}

bool all_numbers(const Json& list) {
  return std::all_of(list.begin(), list.end(), [](const Json& x) { return x.is_number(); });
}

bool all_texts(const Json& list) {
  return std::all_of(list.begin(), list.end(), [](const Json& x) { return x.is_string(); });
}

/// Lists of lists of numbers are text: JSON writes them as TOML does.
std::optional<ParameterValue> as_value(const Json& json) {
  if (json.is_null()) return std::nullopt;
  if (json.is_boolean()) return json.get<bool>();
  if (json.is_number()) return json.get<double>();
  if (json.is_string()) return json.get<std::string>();
  if (json.is_array() && all_numbers(json)) return json.get<std::vector<double>>();
  if (json.is_array() && all_texts(json)) return json.get<std::vector<std::string>>();
  if (json.is_array() && std::all_of(json.begin(), json.end(), [](const Json& row) {
        return row.is_array() && all_numbers(row);
      })) {
    return json_text(json);
  }
  throw Nonsense{
      "\"value\" has to be a number, true or false, a string, or a list of numbers or strings"};
}

ClientSubscribe subscribe(const Json& message) {
  ClientSubscribe out;
  for_each_object_of(message, "subscriptions", [&](const Json& one) {
    out.subscriptions.push_back(
        {as_id(member(one, "id"), "id"), as_id(member(one, "channelId"), "channelId")});
  });
  return out;
}

ClientAdvertise advertise(const Json& message) {
  ClientAdvertise out;
  for_each_object_of(message, "channels", [&](const Json& one) {
    out.channels.push_back({as_id(member(one, "id"), "id"), as_text(member(one, "topic"), "topic"),
                            as_text(member(one, "encoding"), "encoding")});
  });
  return out;
}

ClientSetParameters set_parameters(const Json& message) {
  ClientSetParameters out{{}, request(message)};
  for_each_object_of(message, "parameters", [&](const Json& one) {
    const auto value = one.find("value");
    out.parameters.push_back({as_text(member(one, "name"), "name"),
                              value == one.end() ? std::nullopt : as_value(*value)});
  });
  return out;
}

ClientMessage understood(const Json& message) {
  const std::string op = as_text(member(message, "op"), "op");
  if (op == "subscribe") return subscribe(message);
  if (op == "unsubscribe") return ClientUnsubscribe{ids(message, "subscriptionIds")};
  if (op == "advertise") return advertise(message);
  if (op == "unadvertise") return ClientUnadvertise{ids(message, "channelIds")};
  if (op == "getParameters") return ClientGetParameters{names(message), request(message)};
  if (op == "setParameters") return set_parameters(message);
  if (op == "subscribeParameterUpdates") return ClientSubscribeParameters{names(message)};
  if (op == "unsubscribeParameterUpdates") return ClientUnsubscribeParameters{names(message)};
  throw Nonsense{fmt::format("\"op\": \"{}\" is not known here", printable(op, 40))};
}

}  // namespace

ClientMessage parse_client_text(std::string_view text) {
  const Json message = try_parse_json(text);
  if (!message.is_object()) return ClientNonsense{"a text message has to be one JSON object"};
  try {
    return understood(message);
  } catch (const Nonsense& nonsense) {
    return ClientNonsense{nonsense.reason};
  }
}

ClientMessage parse_client_binary(std::span<const std::uint8_t> bytes) {
  constexpr std::size_t kHeaderBytes = 5;  // opcode 1, u32 channel in little endian
  if (bytes.size() < kHeaderBytes || bytes[0] != 1) {
    return ClientNonsense{"a binary message has to begin with the byte 1 and a channel's id"};
  }
  ClientData data;
  for (std::size_t i = kHeaderBytes - 1; i > 0; --i) data.channel = data.channel << 8 | bytes[i];
  const auto payload = bytes.subspan(kHeaderBytes);
  data.payload = {reinterpret_cast<const char*>(payload.data()), payload.size()};
  return data;
}

}  // namespace tether
