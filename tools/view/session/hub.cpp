#include "tools/view/session/hub.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "tools/messages/message_json.hpp"
#include "tools/messages/message_schema.hpp"

namespace tether {

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

}  // namespace tether
