#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "tools/view/server/parameter.hpp"

namespace tether {

// Messages of a client of Foxglove's WebSocket protocol. Clients may be anybody: whatever the bytes
// are, the result is one of these, and nothing throws.

struct ClientSubscribe {
  struct One {
    std::uint32_t id = 0;  ///< the client's name for it
    std::uint32_t channel = 0;
  };
  std::vector<One> subscriptions;
};
struct ClientUnsubscribe {
  std::vector<std::uint32_t> ids;
};
/// Channels on which the client is going to publish.
struct ClientAdvertise {
  struct One {
    std::uint32_t id = 0;
    std::string topic;
    std::string encoding;
  };
  std::vector<One> channels;
};
struct ClientUnadvertise {
  std::vector<std::uint32_t> ids;
};
struct ClientGetParameters {
  std::vector<std::string> names;  ///< empty: all
  std::optional<std::string> request;
};
struct ClientSetParameters {
  std::vector<Parameter> parameters;
  std::optional<std::string> request;
};
struct ClientSubscribeParameters {
  std::vector<std::string> names;  ///< empty: all
};
struct ClientUnsubscribeParameters {
  std::vector<std::string> names;  ///< empty: all
};
/// A message that the client publishes; refers to the bytes that were parsed.
struct ClientData {
  std::uint32_t channel = 0;
  std::string_view payload;
};
/// A malformed message, and the reason.
struct ClientNonsense {
  std::string reason;
};

using ClientMessage =
    std::variant<ClientSubscribe, ClientUnsubscribe, ClientAdvertise, ClientUnadvertise,
                 ClientGetParameters, ClientSetParameters, ClientSubscribeParameters,
                 ClientUnsubscribeParameters, ClientData, ClientNonsense>;

/// A list in one message has no more elements, a name no more bytes: the longest message that
/// servers take would have room for more.
inline constexpr std::size_t kMostClientElements = 10'000;
inline constexpr std::size_t kLongestClientName = 1000;

ClientMessage parse_client_text(std::string_view text);
ClientMessage parse_client_binary(std::span<const std::uint8_t> bytes);

}  // namespace tether
