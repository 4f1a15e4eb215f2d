#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "common/base/counters.hpp"
#include "tools/view/protocol/client_message.hpp"
#include "tools/view/protocol/parameter.hpp"
#include "tools/view/protocol/server_message.hpp"
#include "tools/view/session/derived.hpp"
#include "tools/view/session/session.hpp"

namespace tether {

using ClientId = std::uint64_t;

/// Request of a client to the program that the server shows.
struct ViewRequest {
  struct Publish {
    std::string topic;
    std::string json;
  };
  ClientId client = 0;
  std::optional<std::string> request;  ///< the client's name for it
  /// Parameters to set, all at once; or a message to publish.
  std::variant<std::vector<Parameter>, Publish> what;
};

/// Result of a request.
struct ViewAnswer {
  ClientId client = 0;
  std::optional<std::string> request;
  std::vector<std::string> parameters;  ///< whose values are to be sent to the client
  std::string error;                    ///< why nothing was done; empty if it was
};

/// State that all clients share: which channels there are, the newest message of each, parameters.
/// It passes on to each client what it has subscribed to, and its requests to the program.
///
/// Pure: no sockets, clocks or threads. Messages come as LCM bytes and are decoded once, if anybody
/// wants them; a client that subscribes is sent the newest at once.
class Hub {
 public:
  struct Options {
    ServerInfo info;
    std::vector<std::string> publishable;  ///< topics on which clients may publish
    std::size_t most_channels = 2000;
    Session::Limits limits = {};
  };
  Hub(Options options, std::function<void(ViewRequest)> ask,
      std::unique_ptr<DerivedChannels> derived = nullptr);

  ClientId connect();
  void disconnect(ClientId client);
  /// The client is connected.
  Session& session(ClientId client) { return *clients_.at(client); }
  std::size_t clients() const { return clients_.size(); }

  void on_text(ClientId client, std::string_view text);
  void on_binary(ClientId client, std::span<const std::uint8_t> bytes);

  /// A message on an LCM channel.
  void hear(std::string_view topic, std::span<const std::uint8_t> bytes, std::uint64_t time_ns);
  /// A channel of this topic whose messages are JSON already, and its next message.
  void publish(const DerivedChannels::Description& channel, std::uint64_t time_ns,
               std::string json);
  /// New ones are added; clients that have subscribed to one receive its change.
  void update(const std::vector<Parameter>& parameters);
  void answer(const ViewAnswer& answer);
  void say(StatusLevel level, std::string_view text);
  void tell_time(std::uint64_t time_ns);

  CounterList counters() const;

 private:
  struct Channel {
    std::uint32_t id = 0;
    std::int64_t fingerprint = 0;  ///< 0: its messages are JSON
    bool is_for_derived = false;   ///< derived channels are made of it
    std::vector<std::pair<ClientId, std::uint32_t>> subscribers;  ///< and their subscriptions
    std::vector<std::uint8_t> last;
    SharedText last_json;  ///< JSON of `last`, if a client needed it
    std::uint64_t last_ns = 0;
  };
  struct Handle;

  Channel* channel_of(std::string_view topic, std::span<const std::uint8_t> bytes);
  Channel& add_channel(std::string_view topic, std::int64_t fingerprint,
                       const std::string& schema_name, const std::string& schema);
  void remove_channel(std::map<std::string, Channel, std::less<>>::iterator found);
  void forward(Channel& channel, SharedText json, std::uint64_t time_ns);
  void derive(std::string_view topic, const MessageContent& message, std::uint64_t time_ns);
  bool derived_wanted() const;
  bool is_derived(std::uint32_t id) const;
  void derive_all();
  Channel* find_channel(std::uint32_t id);
  void unsubscribe(ClientId client, std::uint32_t subscription);
  void complain(ClientId client, std::string_view reason);
  void tell(ClientId client, std::string text);
  void tell_all(std::string text);
  void send_values(ClientId client, const std::vector<std::string>& names,
                   const std::optional<std::string>& request);
  std::vector<Parameter> values_of(const std::vector<std::string>& names) const;

  Options options_;
  std::function<void(ViewRequest)> ask_;
  std::unique_ptr<DerivedChannels> derived_;
  std::map<ClientId, std::unique_ptr<Session>> clients_;
  std::map<std::string, Channel, std::less<>> channels_;  ///< by topic
  std::map<std::uint32_t, AdvertisedChannel> advertised_;
  std::vector<Parameter> parameters_;  ///< in the order in which they came
  std::map<std::string, std::size_t, std::less<>> parameter_places_;
  ClientId last_client_ = 0;
  std::uint32_t next_channel_ = 1;
  std::int64_t heard_ = 0, undecodable_ = 0, too_many_channels_ = 0, nonsense_ = 0;
  std::int64_t dropped_by_gone_ = 0;  ///< messages that were not read by clients that are gone
};

}  // namespace tether
