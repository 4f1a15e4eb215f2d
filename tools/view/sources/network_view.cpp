#include "tools/view/sources/network_view.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <tether/channel_setting_t.hpp>
#include <tether/drive_request_t.hpp>
#include <tether/drivetrain_state_t.hpp>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "common/node/message_io.hpp"
#include "common/node/real_time_loop.hpp"
#include "netem/relay/live_settings.hpp"
#include "tools/base/json.hpp"

namespace tether {

std::int32_t parse_operator_request(std::string_view json) {
  using Request = drive_request_t;
  static constexpr std::array<std::pair<const char*, std::int32_t>, 6> kNames{{
      {"ARM", Request::ARM},
      {"DISARM", Request::DISARM},
      {"ESTOP", Request::ESTOP},
      {"ESTOP_RELEASE", Request::ESTOP_RELEASE},
      {"RESET", Request::RESET},
      {"ALIVE", Request::ALIVE},
  }};
  const auto message = try_parse_json(json);
  if (message.is_object() && message.contains("request")) {
    const auto& wanted = message["request"];
    for (const auto& [name, number] : kNames) {
      if (wanted == name || wanted == number) return number;
    }
  }
  throw UsageError(
      "a request of the drivetrain has to be {\"request\": R} with R one of \"ARM\", \"DISARM\", "
      "\"ESTOP\", \"ESTOP_RELEASE\", \"RESET\", \"ALIVE\"");
}

namespace {

/// Simulators send twenty a second.
constexpr Duration kClockPatience = std::chrono::seconds{1};

double number(const nlohmann::json& twist, const char* name, double limit) {
  if (twist.is_object() && twist.contains(name) && twist[name].is_number()) {
    const auto x = twist[name].get<double>();
    if (std::isfinite(x) && std::abs(x) <= limit) return x;
  }
  throw UsageError(
      "a twist has to be {\"v_mps\": V, \"omega_radps\": W} with V in [-10, 10], W in [-5, 5]");
}

}  // namespace

void HandDrive::hear(const clock_t& clock, Instant now) {
  if (clock_ && clock_->run != clock.run) pose_utime_ = -1;
  clock_ = clock;
  clock_at_ = now;
}

void HandDrive::hear(const pose_t& pose) {
  if (clock_ && pose.run == clock_->run) pose_utime_ = std::max(pose_utime_, pose.utime);
}

twist_t HandDrive::stamped(double v_mps, double omega_radps, Instant now) {
  twist_t twist{};
  const double gone_us = 1e6 * to_seconds(now - clock_at_) * clock_->rate;
  twist.utime = clock_->utime + std::llround(gone_us);
  twist.seq = seq_++;
  twist.run = clock_->run;
  twist.pose_utime = pose_utime_;
  twist.v_mps = v_mps;
  twist.omega_radps = omega_radps;
  return twist;
}

twist_t HandDrive::take(ClientId client, std::string_view json, Instant now) {
  const auto twist = try_parse_json(json);
  const double v_mps = number(twist, "v_mps", kFastest_mps);
  const double omega_radps = number(twist, "omega_radps", kFastest_radps);
  if (!clock_ || now - clock_at_ > kClockPatience) {
    throw UsageError("there is nothing to drive: no SIM/CLOCK was heard for a second");
  }
  if (is_held(now) && *driver_ != client) throw UsageError("another client is driving");
  driver_ = client;
  driven_at_ = now;
  zeros_ = kZeros;
  return stamped(v_mps, omega_radps, now);
}

std::optional<twist_t> HandDrive::tick(Instant now) {
  if (is_held(now) || zeros_ == 0 || !clock_) return std::nullopt;
  --zeros_;
  return stamped(0.0, 0.0, now);
}

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
