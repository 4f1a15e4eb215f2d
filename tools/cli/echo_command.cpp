#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <lcm/lcm-cpp.hpp>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>

#include "common/base/errors.hpp"
#include "common/base/pattern.hpp"
#include "common/bus/bus.hpp"
#include "common/lcm/lcm_bus.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/loop/real_time_loop.hpp"
#include "common/program/cli.hpp"
#include "common/program/cli_range.hpp"
#include "tools/base/text_output.hpp"
#include "tools/cli/commands.hpp"
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

Pattern checked_pattern(const std::string& text) {
  try {
    return Pattern(text);
  } catch (const UsageError& error) {
    throw UsageError(
        fmt::format("channel: {}; it must match whole names, such as \"AGV/.*\"", error.what()));
  }
}

/// Prints what it hears. It uses LCM directly, not through the Bus, for LCM's receive time: that
/// is the kernel's, so waiting in queues of this process does not show up as jitter.
class Echo {
 public:
  Echo(const EchoOptions& options, RealTimeLoop& loop)
      : options_(options),
        pattern_(checked_pattern(options.channel_regex)),
        url_(reachable_lcm_url(options.lcm_url)),
        lcm_(url_),
        loop_(loop) {
    if (!lcm_.good() || lcm_.getFileno() < 0) {
      throw std::runtime_error(fmt::format("cannot reach the LCM network {}", url_));
    }
    // Everything, and chosen here: LCM has another kind of regular expression, and for one that it
    // cannot compile LCM 1.3.1 returns a subscription that crashes when it is used.
    lcm_.subscribeFunction(".*", &Echo::on_message, this)->setQueueCapacity(kDeepQueue);
    loop_.add_fd(lcm_.getFileno(), [this](Instant) { handle_pending(); });
  }

  void run() {
    if (options_.duration_s) {
      loop_.run_until(loop_.now() + from_seconds(*options_.duration_s));
    } else {
      loop_.run();
    }
    if (!options_.quiet) out_.write("\n");
    out_.write(table_.format());
    if (malformed_ > 0) out_.write(fmt::format("{} malformed packets\n", malformed_));
    out_.close();
  }

 private:
  void handle_pending() {
    constexpr int kBurst = 64;  // the loop's timers and signals get their turn in between
    for (int i = 0; i < kBurst && !done(); ++i) {
      const int handled = lcm_.handleTimeout(0);
      if (error_) std::rethrow_exception(error_);
      if (handled < 0) throw std::runtime_error(fmt::format("lost the LCM network {}", url_));
      if (handled == 0) break;
    }
    out_.flush();
    if (done()) loop_.stop();
  }

  bool done() const { return options_.count && shown_ >= *options_.count; }

  // A plain function: GCC 12's sanitizers trip over LCM's calls through pointers to members.
  static void on_message(const lcm::ReceiveBuffer* buffer, const std::string& channel, Echo* self) {
    try {
      self->show(*buffer, channel);
    } catch (...) {
      self->error_ = std::current_exception();  // must not pass through LCM's C frames
    }
  }

  void show(const lcm::ReceiveBuffer& buffer, const std::string& channel) {
    if (done() || !wanted(channel)) return;
    if (buffer.data_size > (1U << 28)) {  // LCM's underflow on a packet without payload
      ++malformed_;
      return;
    }
    const MessageContent message =
        inspect_message({static_cast<const std::uint8_t*>(buffer.data), buffer.data_size});
    table_.on_message(channel, buffer.recv_utime, message);
    if (!options_.quiet) out_.write(format_message(channel, message) + "\n");
    ++shown_;
  }

  bool wanted(const std::string& channel) {
    if (options_.channel_regex == ".*") return true;
    const auto known = wanted_.find(channel);
    if (known != wanted_.end()) return known->second;
    const bool matches = pattern_.matches(channel);
    if (wanted_.size() < ChannelTable::kMaxChannels) wanted_.emplace(channel, matches);
    return matches;
  }

  EchoOptions options_;
  Pattern pattern_;
  std::string url_;
  lcm::LCM lcm_;
  RealTimeLoop& loop_;
  TextOutput out_;
  ChannelTable table_;
  std::map<std::string, bool> wanted_;
  std::int64_t shown_ = 0;
  std::int64_t malformed_ = 0;
  std::exception_ptr error_;
};

int echo(const EchoOptions& options) {
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
