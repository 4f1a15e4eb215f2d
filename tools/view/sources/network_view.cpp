#include "tools/view/sources/network_view.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <tether/channel_setting_t.hpp>
#include <tether/drive_request_t.hpp>
#include <tether/drivetrain_state_t.hpp>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "common/bus/message_io.hpp"
#include "common/loop/real_time_loop.hpp"
#include "netem/relay/setting_requests.hpp"
#include "tools/view/sources/operator_request.hpp"

namespace tether {
namespace {

constexpr Duration kAskAgain = std::chrono::seconds{1};
/// For a relay's answer.
constexpr Duration kPatience = std::chrono::seconds{3};

}  // namespace

NetworkView::NetworkView(EventLoop& loop, Bus& bus, ViewServer& server, Options options)
    : loop_(loop),
      bus_(bus),
      server_(server),
      vehicles_(std::move(options.vehicles)),
      channels_(vehicles_.front()),
      parameters_(std::move(options.parameters)),
      may_drive_(options.may_drive),
      seq_(RealTimeLoop::number_of_this_start()) {
  for (const std::string& vehicle : vehicles_) {
    answers_[ChannelNames(vehicle).net_settings] = vehicle;
  }
  bus_.subscribe(".*", kDeepQueue, [this](const Message& message) { hear(message); });
  server_.update(parameters_.values());
  if (may_drive_) {
    loop_.every(loop_.now(), HandDrive::kPeriod, Priority::observer, [this](Instant now) {
      if (const auto stop = drive_.tick(now)) send(channels_.control_command, *stop);
    });
  }
  if (!options.ask_relay) {
    relay_known_ = true;
    return;
  }
  loop_.every(loop_.now(), kAskAgain, Priority::observer, [this](Instant) {
    if (!relay_known_) ask();
  });
}

std::vector<std::string> NetworkView::publishable(const std::vector<std::string>& vehicles,
                                                  bool may_drive) {
  const ChannelNames channels(vehicles.front());
  std::vector<std::string> topics;
  if (vehicles.size() == 1) topics.push_back(channels.can_request);
  if (may_drive) topics.push_back(channels.control_command);
  return topics;
}

std::uint64_t NetworkView::time_ns(const Message& message) const {
  if (message.received_utime > 0) return static_cast<std::uint64_t>(message.received_utime) * 1000;
  if (loop_.run_id() != 0) return static_cast<std::uint64_t>(RealTimeLoop::wall_utime_us()) * 1000;
  return static_cast<std::uint64_t>(
      std::max(Duration::zero(), loop_.now().time_since_epoch()).count());
}

void NetworkView::hear(const Message& message) {
  server_.hear(message.channel, message.bytes, time_ns(message));
  if (may_drive_) hear_for_driving(message);
  if (const auto answers = answers_.find(message.channel); answers != answers_.end()) {
    channel_setting_result_t answer{};
    if (decode(message.bytes, answer)) on_answer(answers->second, answer);
  } else if (message.channel == channels_.can_state) {
    drivetrain_state_t state{};
    if (!decode(message.bytes, state)) return;
    bridge_utime_ = state.utime;
    bridge_run_ = state.run;
  }
}

void NetworkView::hear_for_driving(const Message& message) {
  if (message.channel == channels_.clock) {
    clock_t clock{};
    if (decode(message.bytes, clock)) drive_.hear(clock, loop_.now());
  } else if (message.channel == channels_.control_pose) {
    pose_t pose{};
    if (decode(message.bytes, pose)) drive_.hear(pose);
  }
}

void NetworkView::on_answer(const std::string& vehicle, const channel_setting_result_t& answer) {
  const RequestName name{answer.request_utime, answer.request_seq};
  const bool is_all = name == asked_;
  if (vehicle == vehicles_.front()) {
    relay_ahead_us_ = answer.utime - to_utime(loop_.now());
    if (is_all || answer.applied != 0) {
      std::vector<ChannelSetting> settings;
      for (std::size_t i = 0; i < answer.key.size(); ++i) {
        settings.push_back({answer.key[i], answer.value[i]});
      }
      parameters_.take(settings, is_all);
      server_.update(parameters_.values());
      relay_known_ = relay_known_ || is_all;
    }
  }
  const auto found = pending_.find(name);
  if (found == pending_.end()) return;
  Pending& pending = found->second;
  if (answer.applied == 0) pending.refused[vehicle] = printable_message(answer.reason);
  pending.silent.erase(vehicle);
  if (!pending.silent.empty()) return;
  server_.answer({pending.client, pending.request, pending.parameters, outcome(pending)});
  pending_.erase(found);
}

/// Outcome of a setting that all have answered; "" if it is in force.
std::string NetworkView::outcome(const Pending& pending) const {
  if (pending.refused.empty()) return "";
  const auto& [first, why] = *pending.refused.begin();
  if (pending.refused.size() == vehicles_.size()) return "refused, nothing has changed: " + why;
  std::vector<std::string> names;
  for (const auto& [name, reason] : pending.refused) names.push_back(name);
  return fmt::format("refused by the links of {}, in force for the others: {}",
                     fmt::join(names, ", "), why);
}

std::int64_t NetworkView::relay_utime() const { return to_utime(loop_.now()) + relay_ahead_us_; }

template <class LcmType>
void NetworkView::send(const std::string& channel, const LcmType& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  bus_.publish(channel, bytes);
  if (!bus_.hears_itself()) server_.hear(channel, bytes, time_ns({}));
}

/// Which settings are in force.
void NetworkView::ask() {
  const channel_setting_t question = setting_request(relay_utime(), ++seq_, {});
  asked_ = {question.utime, question.seq};
  send(channels_.net_set, question);
}

bool NetworkView::take(const ViewRequest& request) {
  if (const auto* publish = std::get_if<ViewRequest::Publish>(&request.what)) {
    operate(request, *publish);
    return true;
  }
  const auto& parameters = std::get<std::vector<Parameter>>(request.what);
  const auto is_ours = [](const Parameter& p) { return NetworkParameters::owns(p.name); };
  if (!std::all_of(parameters.begin(), parameters.end(), is_ours)) return false;
  set(request, parameters);
  return true;
}

void NetworkView::set(const ViewRequest& request, const std::vector<Parameter>& parameters) {
  Pending pending{request.client, request.request, {}, {vehicles_.begin(), vehicles_.end()}};
  for (const Parameter& parameter : parameters) pending.parameters.push_back(parameter.name);
  try {
    const channel_setting_t message =
        setting_request(relay_utime(), ++seq_, parameters_.settings(parameters));
    const RequestName name{message.utime, message.seq};
    pending_.emplace(name, std::move(pending));
    for (const std::string& vehicle : vehicles_) send(ChannelNames(vehicle).net_set, message);
    loop_.at(loop_.now() + kPatience, Priority::observer, [this, name](Instant) {
      const auto found = pending_.find(name);
      if (found == pending_.end()) return;
      server_.answer({found->second.client, found->second.request, found->second.parameters,
                      fmt::format("no answer on {}: is there a relay (tether-netem)?",
                                  ChannelNames(*found->second.silent.begin()).net_settings)});
      pending_.erase(found);
    });
  } catch (const UsageError& error) {
    server_.answer({pending.client, pending.request, pending.parameters, error.what()});
  }
}

void NetworkView::operate(const ViewRequest& request, const ViewRequest::Publish& what) {
  try {
    if (what.topic == channels_.control_command) {
      send(what.topic, drive_.take(request.client, what.json, loop_.now()));
      return;
    }
    drive_request_t message{};
    message.request = parse_operator_request(what.json);
    message.utime = bridge_utime_;  // the bridge's clock and run, whatever they are
    message.run = bridge_run_;
    message.seq = RealTimeLoop::wall_utime_us();  // must ascend, as in `tether can`
    send(what.topic, message);
  } catch (const UsageError& error) {
    server_.answer({request.client, std::nullopt, {}, error.what()});
  }
}

}  // namespace tether
