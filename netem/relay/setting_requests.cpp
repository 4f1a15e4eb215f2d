#include "netem/relay/setting_requests.hpp"

#include <algorithm>
#include <exception>
#include <utility>

#include "common/bus/message_io.hpp"

namespace tether {
namespace {

constexpr std::size_t kRemembered = 64;
constexpr std::size_t kMostWaiting = 100;
constexpr std::size_t kLongestValue = 1000;  // a message's decoder takes 64 KiB at most

std::string cut(std::string text) {
  if (text.size() <= kLongestValue) return text;
  text.resize(kLongestValue);
  return text + "...";
}

std::vector<std::string> settings_of(const channel_setting_t& request) {
  std::vector<std::string> settings;
  for (std::size_t i = 0; i < request.key.size(); ++i) {
    settings.push_back(request.key[i] + "=" + request.value[i]);
  }
  return settings;
}

channel_setting_result_t result_of(const channel_setting_t& request, const std::string& reason) {
  channel_setting_result_t result{};
  result.request_utime = request.utime;
  result.request_seq = request.seq;
  result.reason = reason;
  return result;
}

}  // namespace

SettingRequests::SettingRequests(EventLoop& loop, std::vector<Bus*> buses,
                                 const ChannelNames& channels, Prepare prepare, Apply apply)
    : loop_(loop),
      buses_(std::move(buses)),
      answers_(channels.net_settings),
      prepare_(std::move(prepare)),
      apply_(std::move(apply)) {
  buses_.erase(std::unique(buses_.begin(), buses_.end()), buses_.end());
  for (Bus* bus : buses_) {
    subscribe<channel_setting_t>(*bus, channels.net_set, kDeepQueue, undecodable_,
                                 [this](const channel_setting_t& m) { take(m); });
  }
}

void SettingRequests::take(const channel_setting_t& request) {
  if (waiting_.size() == kMostWaiting) {
    ++refused_;
    return answer(result_of(request, "too many requests wait already"));
  }
  waiting_.push_back(request);
  if (waiting_.size() == 1) go_on();
}

void SettingRequests::go_on() {
  while (!waiting_.empty()) {
    std::function<void()> work;
    if (known(waiting_.front()) == nullptr) work = prepare_(settings_of(waiting_.front()));
    if (work) {
      return loop_.aside(std::move(work), [this](Instant) {
        carry_out_next();
        go_on();
      });
    }
    carry_out_next();
  }
}

void SettingRequests::carry_out_next() {
  const channel_setting_t request = waiting_.front();
  if (const channel_setting_result_t* result = known(request)) {
    ++repeated_;
    answer(*result);
  } else {
    answer(carried_out(request));
  }
  waiting_.pop_front();
}

const channel_setting_result_t* SettingRequests::known(const channel_setting_t& request) const {
  const auto found = std::find_if(answered_.begin(), answered_.end(), [&](const auto& result) {
    return result.request_utime == request.utime && result.request_seq == request.seq;
  });
  return found == answered_.end() ? nullptr : &*found;
}

channel_setting_result_t SettingRequests::carried_out(const channel_setting_t& request) {
  channel_setting_result_t result = result_of(request, "");
  const std::vector<std::string> settings = settings_of(request);
  try {
    for (const ChannelSetting& setting : apply_(settings)) {
      result.key.push_back(setting.key);
      result.value.push_back(cut(setting.value));
    }
    result.applied = 1;
  } catch (const std::exception& error) {  // a relay does not end because of what it is asked
    result.reason = cut(error.what());
  }
  result.count = static_cast<std::int32_t>(result.key.size());
  if (!settings.empty()) {
    ++(result.applied != 0 ? applied_ : refused_);
    answered_.push_back(result);
    if (answered_.size() > kRemembered) answered_.pop_front();
  }
  return result;
}

void SettingRequests::answer(channel_setting_result_t result) {
  result.utime = to_utime(loop_.now());
  result.seq = seq_++;
  for (Bus* bus : buses_) publish(*bus, answers_, result);
}

void SettingRequests::list_counters(CounterList& out) const {
  const std::pair<const char*, std::int64_t> counters[] = {{"settings.applied", applied_},
                                                           {"settings.refused", refused_},
                                                           {"settings.repeated", repeated_},
                                                           {"settings.undecodable", undecodable_}};
  for (const auto& [name, value] : counters) {
    if (value > 0) out.emplace_back(name, value);
  }
}

channel_setting_t setting_request(std::int64_t utime, std::int64_t seq,
                                  const std::vector<std::string>& settings) {
  channel_setting_t request{};
  request.utime = utime;
  request.seq = seq;
  for (const std::string& text : settings) {
    const auto equals = text.find('=');
    request.key.push_back(text.substr(0, equals));
    request.value.push_back(equals == std::string::npos ? "" : text.substr(equals + 1));
  }
  request.count = static_cast<std::int32_t>(request.key.size());
  return request;
}

}  // namespace tether
