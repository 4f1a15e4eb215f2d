#include <fmt/chrono.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <string>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "common/program/cli.hpp"
#include "tools/base/text_output.hpp"
#include "tools/cli/commands.hpp"
#include "tools/cli/log_export.hpp"
#include "tools/cli/log_out.hpp"
#include "tools/cli/log_page.hpp"
#include "tools/log/csv_export.hpp"
#include "tools/log/log_input.hpp"
#include "tools/messages/event_log.hpp"
#include "tools/messages/message_printer.hpp"
#include "tools/messages/stream_statistics.hpp"

namespace tether {
namespace {

struct LogOptions {
  std::string file;
  std::string channel;
  std::string out;
};

/// lcm-logger stamps with the wall clock, simulated runs with the run's time.
std::string describe_time(std::int64_t timestamp_us) {
  constexpr std::int64_t kYear2000_us = 946'684'800'000'000;
  constexpr std::int64_t kYear3000_us = 32'503'680'000'000'000;
  if (timestamp_us < kYear2000_us || timestamp_us > kYear3000_us) {
    return fmt::format("{:.6f} s", static_cast<double>(timestamp_us) * 1e-6);
  }
  return fmt::format("{:%Y-%m-%d %H:%M:%S}.{:06} UTC", fmt::gmtime(timestamp_us / 1'000'000),
                     timestamp_us % 1'000'000);
}

int log_info(const LogOptions& options) {
  LogInput input(options.file);
  ChannelTable table;
  LoggedEvent event;
  std::int64_t events = 0, first_us = 0, last_us = 0;
  while (input.reader.next(event)) {
    first_us = events == 0 ? event.timestamp_us : std::min(first_us, event.timestamp_us);
    last_us = events == 0 ? event.timestamp_us : std::max(last_us, event.timestamp_us);
    ++events;
    table.on_message(event.channel, event.timestamp_us, inspect_message(event.data));
  }

  TextOutput out;
  out.write(
      fmt::format("{}: {} bytes, {} events\n", options.file, input.reader.offset_bytes(), events));
  if (events > 0) {
    out.write(fmt::format("first {}\nlast  {}\nduration {:.6f} s\n", describe_time(first_us),
                          describe_time(last_us),
                          (static_cast<double>(last_us) - static_cast<double>(first_us)) * 1e-6));
  }
  constexpr std::size_t kShown = 20;
  const auto& damage = input.reader.damage();
  for (std::size_t i = 0; i < std::min(kShown, damage.size()); ++i) {
    out.write(describe(damage[i]) + "\n");
  }
  if (damage.size() > kShown) {
    out.write(fmt::format("DAMAGED: and {} further places\n", damage.size() - kShown));
  }
  if (events > 0) out.write("\n" + table.format());
  out.close();
  return kExitOk;
}

int log_csv(const LogOptions& options) {
  check_not_the_log(options.file, options.out);
  LogInput input(options.file);
  std::set<std::string> channels;
  std::optional<TextOutput> out;  // not before there is something to write
  const MessageType* type = nullptr;
  std::int64_t on_channel = 0, left_out = 0;
  LoggedEvent event;
  while (input.reader.next(event)) {
    if (channels.size() < ChannelTable::kMaxChannels) channels.insert(printable(event.channel));
    if (event.channel != options.channel) continue;
    ++on_channel;
    const MessageContent message = inspect_message(event.data);
    if (!message.decoded() || (type != nullptr && message.type != type)) {
      ++left_out;
      continue;
    }
    if (type == nullptr) {
      type = message.type;
      out.emplace(options.out);
      out->write("t_s," + csv_names(*type) + "\n");
    }
    out->write(csv_row(event.timestamp_us, message));
  }
  if (on_channel == 0) {
    throw UsageError(fmt::format("{} has no channel \"{}\"; it has: {}", options.file,
                                 options.channel, fmt::join(channels, ", ")));
  }
  if (!out) {
    throw UsageError(fmt::format("{}: none of the {} messages on {} is of a type that Tether knows",
                                 options.file, on_channel, options.channel));
  }
  out->close();
  for (const LogDamage& damage : input.reader.damage()) {
    fmt::print(stderr, "{}: {}\n", options.file, describe(damage));
  }
  if (left_out > 0) {
    fmt::print(stderr, "{}: left out {} of {} messages on {}: not of type {}\n", options.file,
               left_out, on_channel, options.channel, type->name);
  }
  return kExitOk;
}

}  // namespace

void add_log_command(CLI::App& tether, Action& action) {
  auto options = std::make_shared<LogOptions>();
  CLI::App* const log = tether.add_subcommand("log", "Look into LCM event logs");
  log->require_subcommand(1);

  CLI::App* const info = log->add_subcommand(
      "info", "Print the content of a log per channel, also of a truncated log");
  info->add_option("file", options->file, "LCM event log")->required();
  info->callback([options, &action] { action = [options] { return log_info(*options); }; });

  CLI::App* const csv = log->add_subcommand(
      "csv", "Export channels as tables: t_s (the log's time stamp), then one column per field");
  csv->add_option("file", options->file, "LCM event log")->required();
  csv->add_option("channel", options->channel, "channel name, such as AGV/POSE [all of them]");
  csv->add_option("--out", options->out,
                  "file to write [standard output]; of all channels: the folder");
  csv->callback([options, &action] {
    action = [options] {
      return options->channel.empty() ? log_csv_all(options->file, options->out)
                                      : log_csv(*options);
    };
  });
  add_log_mcap_command(*log, action);
  add_log_page_command(*log, action);
}

}  // namespace tether
