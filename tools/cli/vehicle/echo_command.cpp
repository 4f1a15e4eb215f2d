#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>

#include "common/base/errors.hpp"
#include "common/base/pattern.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/lcm/udpm_bus.hpp"
#include "common/node/bus.hpp"
#include "common/node/real_time_loop.hpp"
#include "common/program/cli.hpp"
#include "tools/base/text_output.hpp"
#include "tools/cli/vehicle/vehicle_commands.hpp"
#include "tools/messages/message_printer.hpp"
#include "tools/messages/stream_statistics.hpp"

namespace tether {
namespace {

struct EchoOptions {
  std::string channel_regex = ".*";
  std::string lcm_url = kDefaultLcmUrl;
  std::optional<std::int64_t> count;
  std::optional<double> duration_s;
  bool quiet = false;
};

void check_pattern(const std::string& text) {
  try {
    const Pattern compiled(text);
  } catch (const UsageError& error) {
    throw UsageError(
        fmt::format("channel: {}; it must match whole names, such as \"AGV/.*\"", error.what()));
  }
}

/// Prints what it hears.
class Echo {
 public:
  Echo(const EchoOptions& options, RealTimeLoop& loop)
      : options_(options), loop_(loop), bus_(open_bus(options.lcm_url, loop)) {
    check_pattern(options.channel_regex);
    bus_->subscribe(options.channel_regex, kDeepQueue, [this](const Message& m) { show(m); });
  }

  void run() {
    constexpr Duration kPatience = std::chrono::seconds{2};
    loop_.at(loop_.now() + kPatience, Priority::observer, [this](Instant) {
      if (shown_ > 0) return;
      fmt::print(stderr, "nothing yet on {} whose name matches \"{}\"\n", options_.lcm_url,
                 options_.channel_regex);
    });
    if (options_.duration_s) {
      loop_.run_until(loop_.now() + from_seconds(*options_.duration_s));
    } else {
      loop_.run();
    }
    if (!options_.quiet) out_.write("\n");
    out_.write(table_.format());
    CounterList network;
    bus_->list_counters(network);
    for (const auto& [name, count] : network) {
      if (count > 0) out_.write(fmt::format("network.{} = {}\n", name, count));
    }
    out_.close();
  }

 private:
  void show(const Message& heard) {
    if (options_.count && shown_ == *options_.count) return;
    const MessageContent message = inspect_message(heard.bytes);
    table_.on_message(std::string(heard.channel), heard.received_utime, message);
    if (!options_.quiet) out_.write(format_message(heard.channel, message) + "\n");
    out_.flush();
    ++shown_;
    if (options_.count && shown_ == *options_.count) loop_.stop();
  }

  EchoOptions options_;
  RealTimeLoop& loop_;
  std::unique_ptr<Bus> bus_;
  TextOutput out_;
  ChannelTable table_;
  std::int64_t shown_ = 0;
};

int echo(const EchoOptions& options) {
  if (options.channel_regex.ends_with(".lcmlog")) {
    throw UsageError(
        fmt::format("echo: {} is a log, not channels that are heard now; see "
                    "tether log info, csv",
                    options.channel_regex));
  }
  RealTimeLoop loop(RealTimeLoop::wall_utime_us());
  Echo(options, loop).run();
  return kExitOk;
}

}  // namespace

void add_echo_command(CLI::App& tether, Action& action) {
  auto options = std::make_shared<EchoOptions>();
  CLI::App* const command = tether.add_subcommand(
      "echo", "Print LCM messages, decoded, and per channel: rate, losses, jitter");
  command
      ->add_option("channel", options->channel_regex,
                   "channels to print: a regular expression (RE2) for the whole name")
      ->capture_default_str();
  command->add_option("--lcm-url", options->lcm_url, "LCM network")
      ->envname("LCM_DEFAULT_URL")
      ->capture_default_str();
  command->add_option("--count", options->count, "end after this many messages [never]")
      ->check(CLI::PositiveNumber);
  command->add_option("--duration", options->duration_s, "end after this many seconds [never]")
      ->check(number_between(0.0, 1e9));
  command->add_flag("--quiet,--stats-only", options->quiet, "no messages, only the summary");
  command->callback([options, &action] { action = [options] { return echo(*options); }; });
}

}  // namespace tether
