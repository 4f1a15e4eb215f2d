#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/program/cli.hpp"
#include "netem/channel/settings.hpp"
#include "netem/fit/channel_watch.hpp"
#include "netem/relay/make_links.hpp"
#include "netem/stages/jitter_laws.hpp"
#include "tools/base/scenario_options.hpp"
#include "tools/base/text_output.hpp"
#include "tools/cli/netem/netem_commands.hpp"
#include "tools/runs/channel_figure.hpp"
#include "tools/runs/channel_report.hpp"

namespace tether {
namespace {

struct PlotOptions {
  ScenarioOptions scenario;
  std::string link = "downlink";
  std::int64_t packets = 100'000;
  std::string out;
};

int plot(const PlotOptions& options) {
  const Scenario scenario = options.scenario.load();
  const bool up = options.link == "uplink";
  const LinkConfig& config =
      up ? scenario.get<ChannelSettings>().uplink : scenario.get<ChannelSettings>().downlink;
  const auto& jitter = config.own.get<JitterSettings>();
  const LinkTraffic traffic = up ? pose_traffic(scenario) : command_traffic(scenario, false);
  LinkPair links = make_links(scenario);
  std::error_code error;
  std::filesystem::create_directories(options.out, error);
  if (!std::filesystem::is_directory(options.out)) {
    throw UsageError(fmt::format("--out: cannot make the folder \"{}\": {}", options.out,
                                 error ? error.message() : "a file has that name"));
  }
  const ChannelFigure figure{
      fmt::format("{}, {}", options.link, config.model),
      fmt::format("{}, {} delays", options.link,
                  jitter.on() && jitter.law != "table" ? jitter.law
                  : jitter.on()                        ? "tabulated"
                                                       : config.model),
      traffic.interval_s,
      sample_fates(up ? links.uplink : links.downlink, traffic, options.packets),
      expect_link(config, traffic)};
  draw_losses(options.out, figure);
  draw_delays(options.out, figure);
  TextOutput out;
  for (const char* name : {"losses", "delays"}) {
    for (const char* kind : {"png", "svg", "gp", "csv"}) {
      const auto file = std::filesystem::path(options.out) / fmt::format("{}.{}", name, kind);
      if (std::filesystem::exists(file)) out.write(file.string() + "\n");
    }
  }
  out.close();
  return kExitOk;
}

}  // namespace

void add_netem_plot_command(CLI::App& netem, Action& action) {
  auto options = std::make_shared<PlotOptions>();
  CLI::App* const command = netem.add_subcommand(
      "plot",
      "Send packets through one of a scenario's links, without vehicle and controller, and draw "
      "their losses and the distribution of their delays");
  add_scenario(*command, options->scenario)->required();
  add_seed(*command, options->scenario);
  command->add_option("--link", options->link, "uplink or downlink [downlink]")
      ->check(CLI::IsMember({"uplink", "downlink"}));
  command->add_option("--packets", options->packets, "packets offered to the link [100000]")
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{10'000'000}));
  command->add_option("--out", options->out, "folder for the figures, made if missing")->required();
  command->callback([options, &action] { action = [options] { return plot(*options); }; });
}

}  // namespace tether
