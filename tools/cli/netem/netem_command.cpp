#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/program/cli.hpp"
#include "netem/fit/report.hpp"
#include "tools/base/text_output.hpp"
#include "tools/cli/netem/netem_commands.hpp"
#include "tools/netem/fit.hpp"
#include "tools/netem/settings.hpp"

namespace tether {
namespace {

struct FitOptions {
  std::string file;
  FitSelection selection;
  std::string link = "downlink";
  std::string out;
  std::uint64_t seed = 1;
  bool strict = false;
};

std::string as_comment(const std::string& text) {
  std::string result;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    result += end == begin ? "#\n" : "# " + text.substr(begin, end - begin) + "\n";
    begin = end + 1;
  }
  return result;
}

int fit(const FitOptions& options) {
  const FitInput input = read_fit_input(options.file, options.selection);
  const ChannelFit result = fit_channel(input.log, random_stream(options.seed, "fit/goodness"));
  std::string text = describe_fit(result) + "\n";
  for (const std::string& note : input.notes) text += note + "\n";
  TextOutput out(options.out);
  out.write(as_comment(text) + "\n" +
            fit_to_toml(result, options.link, printable(input.description)));
  out.close();
  const bool steady = !options.strict || result.stationarity.beyond_doubt();
  return result.fits() && steady ? kExitOk : kExitFailed;
}

void add_fit(CLI::App& netem, Action& action) {
  auto options = std::make_shared<FitOptions>();
  CLI::App* const command = netem.add_subcommand(
      "fit",
      "Fit channel models to a packet log, and print the best one with its accuracy as a part of a "
      "scenario file. Exit code 1 if no model of the kind fits, or if the loss changes over the "
      "log.");
  command
      ->add_option("file", options->file,
                   "LCM event log, pcap capture of LCM messages, or CSV (seq,time_s of the packets "
                   "that arrived, or time_s,lost of all; optionally delay_ms)")
      ->required();
  command->add_option("--channel", options->selection.channel,
                      "event log: channel whose seq to follow [the only one]");
  command->add_option("--sender", options->selection.sender,
                      "pcap: sender to follow, IP:PORT [the only one]");
  command
      ->add_option("--link", options->link,
                   "section of the scenario: uplink or downlink [downlink]")
      ->check(CLI::IsMember({"uplink", "downlink"}));
  command->add_flag("--strict", options->strict,
                    "exit with 1 also if losses or delays may change (p < 0.05, all tests "
                    "together)");
  command
      ->add_option("--seed", options->seed, "seed of the simulations for the goodness of fit [1]")
      ->check(CLI::Range(std::int64_t{0}, INT64_MAX));
  command->add_option("--out", options->out, "file to write [standard output]");
  command->callback([options, &action] { action = [options] { return fit(*options); }; });
}

struct SettingOptions {
  std::string lcm_url = kDefaultLcmUrl;
  std::vector<std::string> settings;
};

CLI::App* add_setting_command(CLI::App& netem, SettingOptions& options, const char* name,
                              const char* what) {
  CLI::App* const command = netem.add_subcommand(name, what);
  command->add_option("--lcm-url", options.lcm_url, "LCM network")
      ->envname("LCM_DEFAULT_URL")
      ->capture_default_str();
  return command;
}

void add_set_and_show(CLI::App& netem, Action& action) {
  auto options = std::make_shared<SettingOptions>();
  CLI::App* const set = add_setting_command(
      netem, *options, "set",
      "Change settings of a running relay's channel, all at once. Exit code 1 if it refuses");
  set->add_option("settings", options->settings,
                  "KEY=VALUE as in tether run --set, without \"channel.\": downlink.prr=0.45; "
                  "prr=0.45 sets both links; files are the relay's")
      ->required();
  set->callback([options, &action] {
    action = [options] { return netem_set(options->lcm_url, options->settings); };
  });
  add_setting_command(netem, *options, "show",
                      "Print settings of a running relay's channel that differ from the defaults")
      ->callback(
          [options, &action] { action = [options] { return netem_show(options->lcm_url); }; });
}

}  // namespace

void add_netem_command(CLI::App& tether, Action& action) {
  CLI::App* const netem =
      tether.add_subcommand("netem", "The network: models, and a running relay's settings");
  netem->require_subcommand(1);
  add_fit(*netem, action);
  add_netem_import_command(*netem, action);
  add_set_and_show(*netem, action);
  add_netem_scenario_commands(*netem, action);
  add_netem_plot_command(*netem, action);
  netem->footer("`tether netem SCENARIO` and `--rule` are the relay: tether-netem --help");
}

}  // namespace tether
