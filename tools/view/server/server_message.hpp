#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "tools/view/server/parameter.hpp"

namespace tether {

// Messages of a server of Foxglove's WebSocket protocol (foxglove/ws-protocol, docs/spec.md): text
// messages, each one JSON object, and what binary ones begin with. Text that is not UTF-8 has
// U+FFFD where it is wrong; NaN and infinities, which JSON does not know, are null.

inline constexpr char kFoxgloveProtocol[] = "foxglove.websocket.v1";
/// Its name in Foxglove's own SDK; the messages here are the same.
inline constexpr char kFoxgloveSdkProtocol[] = "foxglove.sdk.v1";

struct ServerInfo {
  std::string name;
  std::vector<std::string> capabilities;
  /// Encodings that clients may publish.
  std::vector<std::string> encodings;
  std::vector<std::pair<std::string, std::string>> metadata;
  /// Another one each time that a server starts.
  std::string session;
};
std::string server_info_message(const ServerInfo& info);

/// A channel that clients may subscribe to; its messages are JSON.
struct AdvertisedChannel {
  std::uint32_t id = 0;
  std::string topic;
  std::string schema_name;
  std::string schema;  ///< a JSON Schema
};
std::string advertise_message(std::span<const AdvertisedChannel> channels);
std::string unadvertise_message(std::span<const std::uint32_t> channels);

enum class StatusLevel : std::uint8_t { info, warning, error };
std::string status_message(StatusLevel level, std::string_view text);

/// `request`: the id of the request that this answers, if it had one.
std::string parameter_values_message(std::span<const Parameter> parameters,
                                     const std::optional<std::string>& request);

/// Size of the header before a message's bytes on the wire: opcode 1, u32 subscription, u64
/// nanoseconds, in little endian.
inline constexpr std::size_t kDataHeaderBytes = 13;
std::array<std::uint8_t, kDataHeaderBytes> data_header(std::uint32_t subscription,
                                                       std::uint64_t time_ns);

/// The server's time: opcode 2, u64 nanoseconds.
inline constexpr std::size_t kTimeBytes = 9;
std::array<std::uint8_t, kTimeBytes> time_message(std::uint64_t time_ns);

}  // namespace tether
