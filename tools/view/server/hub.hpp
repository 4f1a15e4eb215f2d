#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <variant>
#include <vector>

#include "common/base/counters.hpp"
#include "tools/view/server/client_message.hpp"
#include "tools/view/server/derived.hpp"
#include "tools/view/server/parameter.hpp"
#include "tools/view/server/server_message.hpp"

namespace tether {

/// Bytes that many clients are sent and none changes.
using SharedText = std::shared_ptr<const std::string>;

/// Series of messages to one client (Outgoing::series).
inline constexpr std::uint64_t kTimeSeries = 0;
inline std::uint64_t series_of(std::uint32_t subscription) {
  return std::uint64_t{1} + subscription;
}

/// One message to a client, as a WebSocket message.
struct Outgoing {
  bool is_text = false;
  std::vector<std::uint8_t> header;  ///< goes first; not of text
  SharedText payload;                ///< may be null: all is in the header
  /// Series of data: the newer message of a series replaces the older. Of messages of a
  /// channel, its subscription.
  std::uint64_t series = 0;

  std::size_t size_bytes() const { return header.size() + (payload ? payload->size() : 0); }
};

/// State of one client in the server: what it wants to hear, and what waits to be sent to it.
/// The queue is bounded, so that a client that does not read costs no more than that: of data, the
/// oldest are dropped and counted, but the newest of each series only if there is nothing else, so
/// that what is sent rarely arrives; text (which channels there are, values of parameters) never is
/// dropped, and a client with too much of it is to be cut off.
class Session {
 public:
  struct Limits {
    std::size_t data_bytes = std::size_t{2} << 20;
    std::size_t text_bytes = std::size_t{4} << 20;
    std::size_t subscriptions = 4096;
    std::size_t publications = 64;
  };
  Session() : Session(Limits{}) {}
  explicit Session(const Limits& limits) : limits_(limits) {}

  void push_text(SharedText text);
  void push_data(Outgoing message);
  /// The next to be sent, in the order of pushing; none if there is none.
  std::optional<Outgoing> next();
  bool idle() const { return texts_.empty() && data_.empty(); }

  /// Data messages that were not sent because the client reads too slowly.
  std::int64_t dropped() const { return dropped_; }
  /// The client has so much text to read that it will not.
  bool is_overwhelmed() const { return text_bytes_ > limits_.text_bytes; }

  const Limits& limits() const { return limits_; }

  // Kept by the hub.
  /// Channels of subscriptions, by the client's ids.
  std::map<std::uint32_t, std::uint32_t> channels;
  std::map<std::uint32_t, std::string> publications;  ///< topics, by the client's ids
  bool all_parameters = false;       ///< it wants to hear of each change of a parameter
  std::set<std::string> parameters;  ///< else of these

 private:
  struct Waiting {
    std::uint64_t place;
    Outgoing message;
  };
  void drop_one();
  void forget(std::uint64_t series);

  Limits limits_;
  std::deque<Waiting> texts_, data_;
  std::unordered_map<std::uint64_t, std::size_t> waiting_;  ///< index of waiting data, by series
  std::size_t text_bytes_ = 0, data_bytes_ = 0;
  std::uint64_t pushed_ = 0;
  std::int64_t dropped_ = 0;
};

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
