// Messages of clients to the hub.

#include <fmt/format.h>

#include "common/base/text.hpp"
#include "tools/messages/message_json.hpp"
#include "tools/view/session/hub.hpp"

namespace tether {

/// One message of one client.
struct Hub::Handle {
  Hub& hub;
  ClientId client;

  Session& session() const { return hub.session(client); }
  void complain(const std::string& reason) const { hub.complain(client, reason); }

  void operator()(const ClientSubscribe& message) const {
    for (const auto& one : message.subscriptions) subscribe(one.id, one.channel);
  }

  void subscribe(std::uint32_t id, std::uint32_t channel_id) const {
    Channel* const channel = hub.find_channel(channel_id);
    if (channel == nullptr) {
      return complain(fmt::format("subscribe: there is no channel {}", channel_id));
    }
    if (session().channels.contains(id)) {
      return complain(fmt::format("subscribe: there is a subscription {} already", id));
    }
    for (const auto& [subscriber, subscription] : channel->subscribers) {
      if (subscriber != client) continue;
      return complain(fmt::format("subscribe: channel {} is subscribed to already", channel_id));
    }
    if (session().channels.size() >= session().limits().subscriptions) {
      return complain(fmt::format("subscribe: there are {} subscriptions already, the most allowed",
                                  session().limits().subscriptions));
    }
    session().channels.emplace(id, channel_id);
    channel->subscribers.emplace_back(client, id);
    send_last(*channel, id);
    if (hub.is_derived(channel_id)) hub.derive_all();
  }

  /// So that it need not wait for the next.
  void send_last(Channel& channel, std::uint32_t subscription) const {
    if (!channel.last_json && !channel.last.empty()) {
      const MessageContent message = inspect_message(channel.last);
      if (!message.decoded()) return;
      channel.last_json = std::make_shared<const std::string>(message_json(message));
    }
    if (!channel.last_json) return;
    const auto header = data_header(subscription, channel.last_ns);
    session().push_data(
        {false, {header.begin(), header.end()}, channel.last_json, series_of(subscription)});
  }

  void operator()(const ClientUnsubscribe& message) const {
    for (const std::uint32_t id : message.ids) hub.unsubscribe(client, id);
  }

  void operator()(const ClientAdvertise& message) const {
    const auto& publishable = hub.options_.publishable;
    for (const auto& one : message.channels) {
      if (std::find(publishable.begin(), publishable.end(), one.topic) == publishable.end()) {
        complain(fmt::format("advertise: clients may not publish on {} here",
                             printable(one.topic, 100)));
      } else if (one.encoding != "json") {
        complain(fmt::format("advertise: the encoding has to be json, and not {}",
                             printable(one.encoding, 40)));
      } else if (session().publications.size() >= session().limits().publications) {
        complain("advertise: too many channels");
      } else {
        session().publications[one.id] = one.topic;
      }
    }
  }

  void operator()(const ClientUnadvertise& message) const {
    for (const std::uint32_t id : message.ids) session().publications.erase(id);
  }

  void operator()(const ClientGetParameters& message) const {
    hub.send_values(client, message.names, message.request);
  }

  void operator()(const ClientSetParameters& message) const {
    for (const Parameter& parameter : message.parameters) {
      if (hub.parameter_places_.contains(parameter.name)) continue;
      return complain(fmt::format("setParameters: there is no parameter {}; nothing is set",
                                  printable(parameter.name, 100)));
    }
    if (!message.parameters.empty()) hub.ask_({client, message.request, message.parameters});
  }

  /// Who wants all also wants those that are yet to come, such as a relay's further links.
  void operator()(const ClientSubscribeParameters& message) const {
    if (message.names.empty()) session().all_parameters = true;
    for (const std::string& name : message.names) {
      if (hub.parameter_places_.contains(name)) session().parameters.insert(name);
    }
  }

  void operator()(const ClientUnsubscribeParameters& message) const {
    if (message.names.empty()) {
      session().all_parameters = false;
      session().parameters.clear();
    }
    for (const std::string& name : message.names) session().parameters.erase(name);
  }

  void operator()(const ClientData& message) const {
    const auto found = session().publications.find(message.channel);
    if (found == session().publications.end()) {
      return complain(fmt::format("message: channel {} was not advertised", message.channel));
    }
    hub.ask_(
        {client, std::nullopt, ViewRequest::Publish{found->second, std::string(message.payload)}});
  }

  void operator()(const ClientNonsense& message) const {
    ++hub.nonsense_;
    complain(message.reason);
  }
};

void Hub::on_text(ClientId client, std::string_view text) {
  std::visit(Handle{*this, client}, parse_client_text(text));
}

void Hub::on_binary(ClientId client, std::span<const std::uint8_t> bytes) {
  std::visit(Handle{*this, client}, parse_client_binary(bytes));
}

}  // namespace tether
