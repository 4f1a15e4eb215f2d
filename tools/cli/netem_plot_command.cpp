#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/program/cli.hpp"
#include "netem/check/channel_sample.hpp"
#include "netem/link/delay_law.hpp"
#include "netem/models/channel_settings.hpp"
#include "netem/relay/make_links.hpp"
#include "tools/base/text_output.hpp"
#include "tools/cli/commands.hpp"
#include "tools/runs/channel_figure.hpp"
#include "tools/runs/channel_traffic.hpp"

namespace tether {
namespace {

struct PlotOptions {
  std::string scenario_file;
  std::vector<std::string> overrides;
  std::optional<std::uint64_t> seed;
  std::string link = "downlink";
  std::int64_t packets = 100'000;
  std::string out;
};

int plot(const PlotOptions& options) {
  std::vector<std::string> overrides = options.overrides;
  if (options.seed) overrides.push_back(fmt::format("run.seed={}", *options.seed));
  const Scenario scenario = load_scenario(options.scenario_file, overrides);
  const bool up = options.link == "uplink";
  const LinkConfig& config =
      up ? scenario.get<ChannelSettings>().uplink : scenario.get<ChannelSettings>().downlink;
  const LinkTraffic traffic = up ? pose_traffic(scenario) : command_traffic(scenario, false);
  LinkPair links = make_links(scenario);
  std::error_code error;
  std::filesystem::create_directories(options.out, error);
  if (!std::filesystem::is_directory(options.out)) {
    throw UsageError(fmt::format("--out: cannot make the folder \"{}\": {}", options.out,
                                 error ? error.message() : "a file has that name"));
  }
  const ChannelFigure figure{
      fmt::format("{}, {}", options.link, config.model_name()), traffic.interval_s,
      sample_fates(up ? links.uplink : links.downlink, traffic, options.packets),
      expect_link(config, load_delay_table(config.jitter), traffic)};
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
      "Sends packets through one of a scenario's links, without vehicle and controller, and draws "
      "their losses and the distribution of their delays");
  command->add_option("scenario", options->scenario_file, "scenario file (TOML)")->required();
  command
      ->add_option("--set", options->overrides,
                   "override a scenario key: KEY=VALUE (repeatable; channel.X sets both ways)")
      ->allow_extra_args(false);
  command->add_option("--seed", options->seed, "override run.seed")
      ->check(CLI::Range(std::int64_t{0}, INT64_MAX));
  command->add_option("--link", options->link, "uplink or downlink [downlink]")
      ->check(CLI::IsMember({"uplink", "downlink"}));
  command->add_option("--packets", options->packets, "offered to the link [100000]")
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{10'000'000}));
  command->add_option("--out", options->out, "folder for the figures, made if missing")->required();
  command->callback([options, &action] { action = [options] { return plot(*options); }; });
}

}  // namespace tether
