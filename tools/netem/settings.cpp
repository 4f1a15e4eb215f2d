#include "tools/netem/settings.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <tether/channel_setting_result_t.hpp>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/lcm/udpm_bus.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/message_io.hpp"
#include "common/node/real_time_loop.hpp"
#include "common/program/cli.hpp"
#include "netem/channel/change.hpp"
#include "netem/relay/live_settings.hpp"

namespace tether {
namespace {

constexpr Duration kSettingPatience = std::chrono::seconds{3};
constexpr Duration kFilePatience = std::chrono::seconds{60};    // the relay may have to read long
constexpr Duration kAskAgain = std::chrono::milliseconds{500};  // requests may get lost, too

/// Asks the relay on one network and waits for its answers.
class RelayTalk {
 public:
  explicit RelayTalk(const std::string& lcm_url)
      : url_(checked_lcm_url(lcm_url)),
        loop_(RealTimeLoop::wall_utime_us()),
        network_(open_bus(url_, loop_)) {
    subscribe<channel_setting_result_t>(
        bus_, channels_.net_settings, kDeepQueue, undecodable_,
        [this](const channel_setting_result_t& m) { on_answer(m); });
  }

  /// `utime`: of the relay's clock, if known.
  channel_setting_result_t ask(std::int64_t utime, const std::vector<std::string>& settings) {
    const bool of_files = std::any_of(settings.begin(), settings.end(), file_of_setting);
    asked_ = setting_request(utime, RealTimeLoop::wall_utime_us(), settings);
    answer_.reset();
    const Instant end = loop_.now() + (of_files ? kFilePatience : kSettingPatience);
    while (!answer_ && loop_.now() < end) {
      publish(bus_, channels_.net_set, asked_);
      loop_.run_until(std::min(end, loop_.now() + kAskAgain));
      if (loop_.signal() != 0) throw std::runtime_error("interrupted");
    }
    if (answer_) return *answer_;
    throw std::runtime_error(fmt::format("no answer on {} at {}: is tether-netem running there?",
                                         channels_.net_settings, url_));
  }

 private:
  void on_answer(const channel_setting_result_t& answer) {
    if (answer.request_utime != asked_.utime || answer.request_seq != asked_.seq) return;
    answer_ = answer;
    loop_.stop();
  }

  ChannelNames channels_{"AGV"};
  std::string url_;
  RealTimeLoop loop_;
  std::unique_ptr<Bus> network_;
  Bus& bus_ = *network_;
  std::int64_t undecodable_ = 0;
  channel_setting_t asked_{};
  std::optional<channel_setting_result_t> answer_;
};

void print_settings(const channel_setting_result_t& answer) {
  for (std::size_t i = 0; i < answer.key.size(); ++i) {
    fmt::print("  {} = {}\n", printable(answer.key[i]), printable(answer.value[i]));
  }
}

}  // namespace

int netem_set(const std::string& lcm_url, const std::vector<std::string>& settings) {
  for (const std::string& text : settings) {
    if (text.find('=') == std::string::npos || text.front() == '=') {
      throw UsageError(fmt::format("{}: expected KEY=VALUE", text));
    }
  }
  RelayTalk talk(lcm_url);
  const std::int64_t relay_utime = talk.ask(0, {}).utime;
  const channel_setting_result_t answer = talk.ask(relay_utime, settings);
  if (answer.applied == 0) {
    fmt::print("refused, nothing has changed: {}\n", printable(answer.reason));
    return kExitFailed;
  }
  fmt::print("in force since t = {:.3f} s:\n", to_seconds(from_utime(answer.utime)));
  print_settings(answer);
  return kExitOk;
}

int netem_show(const std::string& lcm_url) {
  const channel_setting_result_t answer = RelayTalk(lcm_url).ask(0, {});
  fmt::print("in force at t = {:.3f} s, other than by default:{}\n",
             to_seconds(from_utime(answer.utime)), answer.key.empty() ? " nothing" : "");
  print_settings(answer);
  return kExitOk;
}

}  // namespace tether
