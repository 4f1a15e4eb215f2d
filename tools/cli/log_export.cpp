#include "tools/cli/log_export.hpp"

#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <system_error>
#include <vector>

#include "common/base/errors.hpp"
#include "common/program/cli.hpp"
#include "common/scenario/scenario.hpp"
#include "tools/base/replacing_output.hpp"
#include "tools/base/text_output.hpp"
#include "tools/cli/log_out.hpp"
#include "tools/log/csv_export.hpp"
#include "tools/log/log_input.hpp"
#include "tools/log/log_survey.hpp"
#include "tools/log/mcap_export.hpp"
#include "tools/scene/scene_setting.hpp"

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

}  // namespace

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

}  // namespace tether
