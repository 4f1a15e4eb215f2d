#include "tools/view/server/server_message.hpp"

#include <nlohmann/json.hpp>

#include "tools/base/json.hpp"
namespace tether {
namespace {

using OrderedJson = nlohmann::ordered_json;

std::string to_text(const OrderedJson& json) { return json_text(json); }

template <class Unsigned>
void put_little_endian(std::uint8_t* to, Unsigned value) {
  for (std::size_t i = 0; i < sizeof value; ++i) {
    to[i] = static_cast<std::uint8_t>(value >> (8 * i));
  }
}

}  // namespace

std::string server_info_message(const ServerInfo& info) {
  OrderedJson metadata = OrderedJson::object();
  for (const auto& [key, value] : info.metadata) metadata[key] = value;
  return to_text({{"op", "serverInfo"},
                  {"name", info.name},
                  {"capabilities", info.capabilities},
                  {"supportedEncodings", info.encodings},
                  {"metadata", metadata},
                  {"sessionId", info.session}});
}

std::string advertise_message(std::span<const AdvertisedChannel> channels) {
  OrderedJson list = OrderedJson::array();
  for (const AdvertisedChannel& channel : channels) {
    list.push_back({{"id", channel.id},
                    {"topic", channel.topic},
                    {"encoding", "json"},
                    {"schemaName", channel.schema_name},
                    {"schema", channel.schema},
                    {"schemaEncoding", "jsonschema"}});
  }
  return to_text({{"op", "advertise"}, {"channels", list}});
}

std::string unadvertise_message(std::span<const std::uint32_t> channels) {
  OrderedJson list = OrderedJson::array();
  for (const std::uint32_t id : channels) list.push_back(id);
  return to_text({{"op", "unadvertise"}, {"channelIds", list}});
}

std::string status_message(StatusLevel level, std::string_view text) {
  return to_text({{"op", "status"}, {"level", static_cast<int>(level)}, {"message", text}});
}

std::string parameter_values_message(std::span<const Parameter> parameters,
                                     const std::optional<std::string>& request) {
  OrderedJson list = OrderedJson::array();
  for (const Parameter& parameter : parameters) {
    OrderedJson one = {{"name", parameter.name}};
    if (parameter.value) {
      std::visit([&one](const auto& value) { one["value"] = value; }, *parameter.value);
      if (std::holds_alternative<double>(*parameter.value)) one["type"] = "float64";
      if (std::holds_alternative<std::vector<double>>(*parameter.value)) {
        one["type"] = "float64_array";
      }
    }
    list.push_back(std::move(one));
  }
  OrderedJson message = {{"op", "parameterValues"}, {"parameters", list}};
  if (request) message["id"] = *request;
  return to_text(message);
}

std::array<std::uint8_t, kDataHeaderBytes> data_header(std::uint32_t subscription,
                                                       std::uint64_t time_ns) {
  std::array<std::uint8_t, kDataHeaderBytes> bytes{1};
  put_little_endian(bytes.data() + 1, subscription);
  put_little_endian(bytes.data() + 5, time_ns);
  return bytes;
}

std::array<std::uint8_t, kTimeBytes> time_message(std::uint64_t time_ns) {
  std::array<std::uint8_t, kTimeBytes> bytes{2};
  put_little_endian(bytes.data() + 1, time_ns);
  return bytes;
}

}  // namespace tether
