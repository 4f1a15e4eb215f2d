#include "tools/view/server/hub.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "common/base/text.hpp"
#include "tools/messages/message_json.hpp"
#include "tools/messages/message_schema.hpp"

namespace tether {

void Session::push_text(SharedText text) {
  text_bytes_ += text->size();
  texts_.push_back({pushed_++, {true, {}, std::move(text), 0}});
}

void Session::push_data(Outgoing message) {
  data_bytes_ += message.size_bytes();
  ++waiting_[message.series];
  data_.push_back({pushed_++, std::move(message)});
  while (data_bytes_ > limits_.data_bytes) drop_one();
}

/// One message less.
void Session::forget(std::uint64_t series) {
  const auto found = waiting_.find(series);
  if (--found->second == 0) waiting_.erase(found);
}

/// The oldest that a newer one of its series replaces; the oldest of all if each is the only one.
void Session::drop_one() {
  auto found = std::find_if(data_.begin(), data_.end(), [this](const Waiting& one) {
    return waiting_.at(one.message.series) > 1;
  });
  if (found == data_.end()) found = data_.begin();
  data_bytes_ -= found->message.size_bytes();
  forget(found->message.series);
  data_.erase(found);
  ++dropped_;
}

std::optional<Outgoing> Session::next() {
  if (idle()) return std::nullopt;
  const bool text_first =
      data_.empty() || (!texts_.empty() && texts_.front().place < data_.front().place);
  std::deque<Waiting>& queue = text_first ? texts_ : data_;
  std::optional<Outgoing> message = std::move(queue.front().message);
  queue.pop_front();
  (text_first ? text_bytes_ : data_bytes_) -= message->size_bytes();
  if (!text_first) forget(message->series);
  return message;
}

Hub::Hub(Options options, std::function<void(ViewRequest)> ask,
         std::unique_ptr<DerivedChannels> derived)
    : options_(std::move(options)), ask_(std::move(ask)), derived_(std::move(derived)) {
  if (!derived_) return;
  for (const auto& channel : derived_->channels()) {
    add_channel(channel.topic, 0, channel.schema_name, channel.schema);
  }
}

ClientId Hub::connect() {
  const ClientId client = ++last_client_;
  clients_.emplace(client, std::make_unique<Session>(options_.limits));
  tell(client, server_info_message(options_.info));
  std::vector<AdvertisedChannel> channels;
  for (const auto& [id, channel] : advertised_) channels.push_back(channel);
  tell(client, advertise_message(channels));
  return client;
}

void Hub::disconnect(ClientId client) {
  const auto found = clients_.find(client);
  if (found == clients_.end()) return;
  dropped_by_gone_ += found->second->dropped();
  while (!found->second->channels.empty()) {
    unsubscribe(client, found->second->channels.begin()->first);
  }
  clients_.erase(found);
}

Hub::Channel& Hub::add_channel(std::string_view topic, std::int64_t fingerprint,
                               const std::string& schema_name, const std::string& schema) {
  Channel& channel = channels_[std::string(topic)];
  channel.id = next_channel_++;
  channel.fingerprint = fingerprint;
  const AdvertisedChannel advertised{channel.id, std::string(topic), schema_name, schema};
  tell_all(advertise_message({&advertised, 1}));
  advertised_.emplace(channel.id, advertised);
  return channel;
}

void Hub::remove_channel(std::map<std::string, Channel, std::less<>>::iterator found) {
  const std::uint32_t id = found->second.id;
  for (const auto& [client, subscription] : found->second.subscribers) {
    session(client).channels.erase(subscription);
  }
  channels_.erase(found);
  advertised_.erase(id);
  tell_all(unadvertise_message({&id, 1}));
}

/// The channel for a message; null if it cannot be shown.
Hub::Channel* Hub::channel_of(std::string_view topic, std::span<const std::uint8_t> bytes) {
  std::uint64_t fingerprint = 0;
  for (const std::uint8_t byte : bytes.first(std::min<std::size_t>(8, bytes.size()))) {
    fingerprint = fingerprint << 8 | byte;
  }
  const auto wanted = static_cast<std::int64_t>(fingerprint);
  const auto found = channels_.find(topic);
  if (found != channels_.end() && found->second.fingerprint == wanted) return &found->second;
  const MessageType* const type = find_message_type(wanted);
  const bool is_ours = found != channels_.end() && found->second.fingerprint == 0;
  if (type == nullptr || is_ours || !inspect_message(bytes).decoded()) {
    ++undecodable_;
    return nullptr;
  }
  if (found != channels_.end()) {
    remove_channel(found);
  } else if (channels_.size() >= options_.most_channels) {
    ++too_many_channels_;
    return nullptr;
  }
  Channel& channel = add_channel(topic, wanted, schema_name(*type), json_schema(*type));
  channel.is_for_derived = derived_ && derived_->reads(topic, *type);
  return &channel;
}

void Hub::hear(std::string_view topic, std::span<const std::uint8_t> bytes, std::uint64_t time_ns) {
  ++heard_;
  Channel* const channel = channel_of(topic, bytes);
  if (channel == nullptr) return;
  channel->last.assign(bytes.begin(), bytes.end());
  channel->last_json = nullptr;
  channel->last_ns = time_ns;
  const bool is_for_derived = channel->is_for_derived && derived_wanted();
  if (channel->subscribers.empty() && !is_for_derived) return;
  const MessageContent message = inspect_message(bytes);
  if (!message.decoded()) {
    ++undecodable_;
    return;
  }
  if (!channel->subscribers.empty()) {
    forward(*channel, std::make_shared<const std::string>(message_json(message)), time_ns);
  }
  if (is_for_derived) derive(topic, message, time_ns);
}

void Hub::forward(Channel& channel, SharedText json, std::uint64_t time_ns) {
  for (const auto& [client, subscription] : channel.subscribers) {
    const auto header = data_header(subscription, time_ns);
    session(client).push_data(
        {false, {header.begin(), header.end()}, json, series_of(subscription)});
  }
  channel.last_json = std::move(json);
  channel.last_ns = time_ns;
}

/// Whether anybody listens to one of them.
bool Hub::derived_wanted() const {
  if (!derived_) return false;
  const auto& channels = derived_->channels();
  return std::any_of(channels.begin(), channels.end(), [this](const auto& description) {
    const auto found = channels_.find(description.topic);
    return found != channels_.end() && !found->second.subscribers.empty();
  });
}

bool Hub::is_derived(std::uint32_t id) const {
  if (!derived_) return false;
  const auto& channels = derived_->channels();
  const std::string& topic = advertised_.at(id).topic;
  return std::any_of(channels.begin(), channels.end(),
                     [&topic](const auto& description) { return description.topic == topic; });
}

/// From the newest message of each channel, for a client that begins to listen.
void Hub::derive_all() {
  for (const auto& [topic, channel] : channels_) {
    if (!channel.is_for_derived || channel.last.empty()) continue;
    const MessageContent message = inspect_message(channel.last);
    if (message.decoded()) derive(topic, message, channel.last_ns);
  }
}

void Hub::derive(std::string_view topic, const MessageContent& message, std::uint64_t time_ns) {
  derived_->on_message(topic, message, time_ns, [&](std::size_t number, std::string json) {
    publish(derived_->channels().at(number), time_ns, std::move(json));
  });
}

void Hub::publish(const DerivedChannels::Description& description, std::uint64_t time_ns,
                  std::string json) {
  auto found = channels_.find(description.topic);
  if (found != channels_.end() && found->second.fingerprint != 0) {
    remove_channel(found);  // any LCM channel of this name
    found = channels_.end();
  }
  Channel& channel =
      found != channels_.end()
          ? found->second
          : add_channel(description.topic, 0, description.schema_name, description.schema);
  forward(channel, std::make_shared<const std::string>(std::move(json)), time_ns);
}

void Hub::update(const std::vector<Parameter>& parameters) {
  std::vector<std::string> changed;
  for (const Parameter& parameter : parameters) {
    const auto found = parameter_places_.find(parameter.name);
    if (found == parameter_places_.end()) {
      parameter_places_.emplace(parameter.name, parameters_.size());
      parameters_.push_back(parameter);
    } else if (parameters_[found->second] != parameter) {
      parameters_[found->second] = parameter;
    } else {
      continue;
    }
    changed.push_back(parameter.name);
  }
  for (const auto& [client, session] : clients_) {
    std::vector<std::string> wanted;
    for (const std::string& name : changed) {
      if (session->all_parameters || session->parameters.contains(name)) wanted.push_back(name);
    }
    if (!wanted.empty()) send_values(client, wanted, std::nullopt);
  }
}

void Hub::answer(const ViewAnswer& answer) {
  if (!clients_.contains(answer.client)) return;  // it did not wait
  if (!answer.error.empty()) complain(answer.client, answer.error);
  const bool is_wanted = answer.request || !answer.error.empty();
  if (is_wanted && !answer.parameters.empty()) {
    send_values(answer.client, answer.parameters, answer.request);
  }
}

void Hub::say(StatusLevel level, std::string_view text) { tell_all(status_message(level, text)); }

void Hub::tell_time(std::uint64_t time_ns) {
  const auto bytes = time_message(time_ns);
  for (const auto& [client, session] : clients_) {
    session->push_data({false, {bytes.begin(), bytes.end()}, nullptr, kTimeSeries});
  }
}

Hub::Channel* Hub::find_channel(std::uint32_t id) {
  const auto found = advertised_.find(id);
  return found == advertised_.end() ? nullptr : &channels_.find(found->second.topic)->second;
}

void Hub::unsubscribe(ClientId client, std::uint32_t subscription) {
  auto& of_client = session(client).channels;
  const auto found = of_client.find(subscription);
  if (found == of_client.end()) return;
  if (Channel* const channel = find_channel(found->second)) {
    std::erase(channel->subscribers, std::pair{client, subscription});
  }
  of_client.erase(found);
}

void Hub::tell(ClientId client, std::string text) {
  session(client).push_text(std::make_shared<const std::string>(std::move(text)));
}

void Hub::tell_all(std::string text) {
  const auto shared = std::make_shared<const std::string>(std::move(text));
  for (const auto& [client, session] : clients_) session->push_text(shared);
}

void Hub::complain(ClientId client, std::string_view reason) {
  tell(client, status_message(StatusLevel::error, reason));
}

std::vector<Parameter> Hub::values_of(const std::vector<std::string>& names) const {
  if (names.empty()) return parameters_;
  std::vector<Parameter> values;
  for (const std::string& name : names) {
    const auto found = parameter_places_.find(name);
    if (found != parameter_places_.end()) values.push_back(parameters_[found->second]);
  }
  return values;
}

void Hub::send_values(ClientId client, const std::vector<std::string>& names,
                      const std::optional<std::string>& request) {
  tell(client, parameter_values_message(values_of(names), request));
}

CounterList Hub::counters() const {
  std::int64_t dropped = dropped_by_gone_;
  for (const auto& [client, session] : clients_) dropped += session->dropped();
  return {{"clients", static_cast<std::int64_t>(clients_.size())},
          {"channels", static_cast<std::int64_t>(channels_.size())},
          {"messages.heard", heard_},
          {"messages.not_decodable", undecodable_},
          {"messages.of_too_many_channels", too_many_channels_},
          {"messages.dropped_for_slow_clients", dropped},
          {"clients.nonsense", nonsense_}};
}

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
