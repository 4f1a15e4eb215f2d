#include <fmt/chrono.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <system_error>
#include <vector>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "common/program/cli.hpp"
#include "common/scenario/scenario.hpp"
#include "tools/base/replacing_output.hpp"
#include "tools/base/text_output.hpp"
#include "tools/cli/commands.hpp"
#include "tools/cli/log_out.hpp"
#include "tools/cli/view_command.hpp"
#include "tools/log/csv_export.hpp"
#include "tools/log/log_input.hpp"
#include "tools/log/log_survey.hpp"
#include "tools/log/mcap_export.hpp"
#include "tools/log/scene_setting.hpp"
#include "tools/messages/event_log.hpp"
#include "tools/messages/message_printer.hpp"
#include "tools/messages/stream_statistics.hpp"
#include "tools/view/server/page_folder.hpp"
#include "tools/view/sources/gzip.hpp"
#include "tools/view/sources/one_file_page.hpp"
#include "tools/view/sources/recording.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;

struct McapOptions {
  std::string file;
  std::string out;
  std::string scenario;
  bool ros2 = false;
};

void tell_left_out(const std::string& file, const LeftOut& left_out,
                   const std::vector<LogDamage>& damage) {
  for (const LogDamage& place : damage) fmt::print(stderr, "{}: {}\n", file, describe(place));
  for (const std::string& line : left_out.lines()) {
    fmt::print(stderr, "{}: left out {}\n", file, line);
  }
}

/// Throws UsageError if there is nothing to convert.
LogSurvey survey_of(const std::string& file) {
  LogInput input(file);
  LogSurvey survey = survey_log(input.reader);
  if (survey.events == 0) throw UsageError(file + " is empty: it has no messages");
  if (survey.channels.empty()) {
    throw UsageError(fmt::format("{}: none of the {} messages is of a type that Tether knows", file,
                                 survey.events));
  }
  return survey;
}

/// Scene shown in addition to the messages: of the scenario that is named, else of the one that
/// `tether run --out` and `tether live --out` put beside the log.
SceneSetting setting_of(const McapOptions& options) {
  if (!options.scenario.empty()) return scene_setting(load_scenario(options.scenario, {}));
  const fs::path beside = fs::path(options.file).parent_path() / "scenario.toml";
  std::error_code ignored;
  if (!fs::is_regular_file(beside, ignored)) return {};
  try {
    return scene_setting(load_scenario(beside.string(), {}));
  } catch (const UsageError& error) {
    fmt::print(stderr, "no path and no shapes: {}\n", error.what());
    return {};
  }
}

int log_mcap(McapOptions options) {
  if (options.out.empty())
    options.out = log_out_beside(options.file, options.ros2 ? ".ros2.mcap" : ".mcap");
  const LogSurvey survey = survey_of(options.file);
  check_log_out(options.file, options.out);
  LogInput input(options.file);
  const McapExport how{options.ros2, setting_of(options), "tether"};
  ReplacingOutput out(options.out);
  const McapExportReport report =
      export_mcap(input.reader, survey, how, [&](std::string_view bytes) { out.write(bytes); });
  if (report.converted == 0) {
    throw UsageError(fmt::format("{}: none of the {} messages has a counterpart in ROS 2",
                                 options.file, report.events));
  }
  out.close();
  TextOutput said;
  said.write(fmt::format("{}: {} messages from {} of the log's {} events, {} bytes\n", options.out,
                         report.messages, report.converted, report.events, report.bytes));
  if (report.shift_us > 0) {
    said.write(fmt::format("times are {} s later than in the log, where they begin below 0\n",
                           report.shift_us / 1'000'000));
  }
  said.close();
  tell_left_out(options.file, report.left_out, report.damage);
  return kExitOk;
}

/// The folder is made, or is there and empty: no table of another log stays beside ours.
void take_folder(const std::string& folder) {
  std::error_code error;
  if (fs::exists(folder, error)) {
    if (!fs::is_directory(folder, error)) {
      throw UsageError(fmt::format("--out {} is not a folder: all channels need one", folder));
    }
    if (!fs::is_empty(folder, error) || error) {
      throw UsageError(fmt::format("--out {} is not empty: name a new folder", folder));
    }
  } else if (!error) {
    fs::create_directories(folder, error);
  }
  if (error) throw UsageError(fmt::format("cannot use --out {}: {}", folder, error.message()));
}

/// `tether log csv FILE --out FOLDER`: all channels. Returns the exit code.
int log_csv_all(const std::string& file, const std::string& folder) {
  if (folder.empty()) {
    throw UsageError("tether log csv of all channels needs --out FOLDER; or name a channel");
  }
  survey_of(file);
  take_folder(folder);
  LogInput input(file);
  const CsvExportReport report = csv_export_all(input.reader, folder);
  TextOutput said;
  for (const CsvFile& table : report.tables) {
    said.write(fmt::format("{}: {} rows, {}\n", (fs::path(folder) / table.file).string(),
                           table.rows, table.type));
  }
  said.close();
  tell_left_out(file, report.left_out, report.damage);
  return kExitOk;
}

/// `tether log mcap`.
void add_log_mcap_command(CLI::App& log, Action& action) {
  auto options = std::make_shared<McapOptions>();
  CLI::App* const mcap = log.add_subcommand(
      "mcap",
      "Export all channels as MCAP, with JSON for Foxglove or, with --ros2, as a ROS 2 bag");
  mcap->add_option("file", options->file, "LCM event log")->required();
  mcap->add_option("--out", options->out,
                   "file to write [the log's name with .mcap, or .ros2.mcap]");
  mcap->add_flag("--ros2", options->ros2,
                 "write a ROS 2 bag: messages with a ROS 2 counterpart, in CDR");
  mcap->add_option("--scenario", options->scenario,
                   "scenario for vehicle, walls and path [scenario.toml beside the log]");
  mcap->callback([options, &action] { action = [options] { return log_mcap(*options); }; });
}

namespace fs = std::filesystem;

struct PageOptions {
  std::string file;
  std::string out;
  std::string page;
  RecordedSpan span;
};

/// Largest page that can still be mailed and opens quickly.
constexpr std::size_t kMostPageBytes = 30'000'000;

int log_page(PageOptions options) {
  if (options.out.empty()) options.out = log_out_beside(options.file, ".html");
  check_log_out(options.file, options.out);
  if (!(options.span.from_s <= options.span.to_s)) {
    throw UsageError(
        fmt::format("--from {} has to be before --to {}", options.span.from_s, options.span.to_s));
  }
  ViewedLog log(options.file);
  const PageFolder folder(options.page.empty() ? shared_page() : fs::path(options.page));
  const Recording recording = record(log, options.span);
  const std::string html = one_file_page(files_of(folder), base64(gzip(recording.text)));
  if (html.size() > kMostPageBytes) {
    throw UsageError(fmt::format(
        "{}: the page would have {:.1f} MB, more than {:.0f} MB: name a part of the log by --from "
        "and --to, or use tether view, which plays any length",
        options.file, static_cast<double>(html.size()) * 1e-6,
        static_cast<double>(kMostPageBytes) * 1e-6));
  }
  ReplacingOutput out(options.out);
  out.write(html);
  out.close();
  TextOutput said;
  said.write(
      fmt::format("{}: {} messages, {} bytes\n", options.out, recording.messages, html.size()));
  said.close();
  for (const std::string& note : log.notes()) fmt::print(stderr, "{}: {}\n", options.file, note);
  for (const std::string& line : recording.left_out.lines()) {
    fmt::print(stderr, "{}: left out {}\n", options.file, line);
  }
  return kExitOk;
}

/// `tether log page`.
void add_log_page_command(CLI::App& log, Action& action) {
  auto options = std::make_shared<PageOptions>();
  CLI::App* const page = log.add_subcommand(
      "page",
      "Export the page of tether view with the log in it: one HTML file, for any browser, offline");
  page->add_option("file", options->file, "LCM event log")->required();
  page->add_option("--out", options->out, "file to write [the log's name with .html]");
  page->add_option("--from", options->span.from_s, "first second to include [all]")
      ->check(number_between(-1e12, 1e12));
  page->add_option("--to", options->span.to_s, "last second to include [all]")
      ->check(number_between(-1e12, 1e12));
  page->add_option("--page", options->page,
                   "folder with the page's files [share/tether/view beside bin]");
  page->callback([options, &action] { action = [options] { return log_page(*options); }; });
}

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
