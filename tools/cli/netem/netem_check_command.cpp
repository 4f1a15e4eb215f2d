#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/node/channel_names.hpp"
#include "common/program/cli.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "controller/laws/law.hpp"
#include "netem/channel/settings.hpp"
#include "netem/fit/channel_watch.hpp"
#include "netem/fit/link_expectation.hpp"
#include "netem/fit/tc_export.hpp"
#include "tools/base/json.hpp"
#include "tools/base/scenario_options.hpp"
#include "tools/base/text_output.hpp"
#include "tools/cli/netem/netem_commands.hpp"
#include "tools/runs/channel_report.hpp"

namespace tether {
namespace {

struct CheckOptions {
  ScenarioOptions scenario;
  std::int64_t packets = 1'000'000;
  bool json = false;
  std::string interface = "eth0";
};

/// On a terminal, how far a trial of more than a second is.
class Progress {
 public:
  explicit Progress(std::int64_t packets)
      : packets_(packets), shown_(Clock::now()), show_(isatty(STDERR_FILENO) != 0) {}
  ~Progress() {
    if (any_) fmt::print(stderr, "\r\033[K");
  }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  void operator()(std::int64_t offered) {
    if (!show_ || Clock::now() - shown_ < std::chrono::seconds{1}) return;
    shown_ = Clock::now();
    any_ = true;
    fmt::print(stderr, "\r\033[K{} of {} packets", offered, packets_);
  }

 private:
  using Clock = std::chrono::steady_clock;
  std::int64_t packets_;
  Clock::time_point shown_;
  bool show_;
  bool any_ = false;
};

std::string table_of(const char* name, const ChannelReport::Direction& link,
                     const LinkTraffic& traffic) {
  return fmt::format("{}: {} packets of {} bytes, one every {:g} ms: {}\n{}\n", name, link.packets,
                     traffic.packet_bytes, traffic.interval_s * 1e3,
                     to_string(overall(link.checks)), to_table(link));
}

nlohmann::ordered_json json_of(const ChannelReport::Direction& link, const LinkTraffic& traffic) {
  nlohmann::ordered_json json;
  json["packets"] = link.packets;
  json["interval_s"] = traffic.interval_s;
  json["packet_bytes"] = traffic.packet_bytes;
  json.update(to_json(link));
  return json;
}

/// Times are counted in nanoseconds.
void check_length(const CheckOptions& options, const Scenario& scenario) {
  constexpr double kLongest_s = 4e9;
  for (const LinkTraffic& traffic : {pose_traffic(scenario), command_traffic(scenario, false)}) {
    if (static_cast<double>(options.packets) * traffic.interval_s <= kLongest_s) continue;
    throw UsageError(fmt::format("--packets {}: at one packet every {:g} s, must be at most {:.0f}",
                                 options.packets, traffic.interval_s,
                                 kLongest_s / traffic.interval_s));
  }
}

/// A model in time takes every change of state, also those that no packet meets.
void announce_work(const CheckOptions& options, const Scenario& scenario) {
  constexpr double kNoticed = 1e8;  // 6 s of work
  double changes = 0.0;
  for (const auto& [link, traffic] :
       {std::pair{&scenario.get<ChannelSettings>().uplink, pose_traffic(scenario)},
        std::pair{&scenario.get<ChannelSettings>().downlink, command_traffic(scenario, false)}}) {
    const LinkExpectation expected = expect_link(*link, traffic);
    if (!expected.channel) continue;
    changes += expected.channel->changes_per_s() * traffic.interval_s *
               static_cast<double>(options.packets);
  }
  if (changes < kNoticed) return;
  const double few = static_cast<double>(options.packets) * kNoticed / changes;
  fmt::print(stderr,
             "tether: the links change state some {:.1g} times between these packets, which takes "
             "its time; --packets {:.0f} take seconds\n",
             changes, std::max(1.0, std::floor(few)));
}

int check(const CheckOptions& options) {
  const Scenario scenario = options.scenario.load();
  check_length(options, scenario);
  announce_work(options, scenario);
  ChannelReport report;
  {
    Progress progress(2 * options.packets);
    report = try_channel(scenario, channel_traffic(scenario, false),
                         {options.packets, std::ref(progress)});
  }
  const LinkTraffic poses = pose_traffic(scenario), commands = command_traffic(scenario, false);
  const double false_alarm = ChannelCheckOptions{}.false_alarm;
  TextOutput out;
  if (options.json) {
    nlohmann::ordered_json json;
    json["seed"] = scenario.get<RunSettings>().seed;
    json["false_alarm"] = false_alarm;
    json["uplink"] = json_of(report.uplink, poses);
    json["downlink"] = json_of(report.downlink, commands);
    out.write(json_text(json, 2) + "\n");
  } else {
    out.write(table_of("uplink", report.uplink, poses));
    out.write(table_of("downlink", report.downlink, commands));
    out.write(
        fmt::format("Verdicts use wider intervals: a link that is right has any \"outside\" "
                    "with a probability of at most {:g}.\n",
                    false_alarm));
  }
  out.close();
  int code = kExitOk;
  for (const auto& [name, link] :
       {std::pair{"uplink", &report.uplink}, {"downlink", &report.downlink}}) {
    const Verdict verdict = overall(link->checks);
    if (verdict == Verdict::ok || verdict == Verdict::not_comparable) continue;
    code = kExitFailed;
    fmt::print(stderr, "tether: {} {}\n", name,
               verdict == Verdict::outside
                   ? "is not as configured"
                   : fmt::format("had too few packets to say: give more than --packets {}",
                                 options.packets));
  }
  return code;
}

std::string commented(const TcExport& link) {
  std::string text = link.command + "\n";
  for (const std::string& note : link.notes) text += "# - " + note + "\n";
  return text;
}

int export_tc_commands(const CheckOptions& options) {
  const Scenario scenario = options.scenario.load();
  const ChannelNames channels(scenario.get<VehicleSettings>().name);
  const std::string& command_channel = kind_of(scenario.get<ControllerSettings>()).sends_plans
                                           ? channels.control_plan
                                           : channels.control_command;
  TextOutput out;
  out.write(fmt::format(
      "# Each as root on the computer that sends; it impairs everything that leaves the interface, "
      "clock\n# and reports included. Where a tether-netem runs, let its links be perfect.\n"
      "# uplink, on the vehicle's computer, which sends {}:\n",
      channels.vehicle_pose));
  out.write(commented(
      export_tc(scenario.get<ChannelSettings>().uplink,
                {options.interface, channels.vehicle_pose, pose_traffic(scenario).interval_s})));
  out.write(
      fmt::format("# downlink, on the controller's computer, which sends {}:\n", command_channel));
  out.write(commented(export_tc(
      scenario.get<ChannelSettings>().downlink,
      {options.interface, command_channel, command_traffic(scenario, false).interval_s})));
  out.close();
  return kExitOk;
}

}  // namespace

void add_netem_scenario_commands(CLI::App& netem, Action& action) {
  auto options = std::make_shared<CheckOptions>();
  CLI::App* const check_command =
      netem.add_subcommand("check",
                           "Send packets through a scenario's links, without vehicle and "
                           "controller, and compare their fates with the configuration. Exit code "
                           "1 if anything is outside, or undecided for lack of packets.");
  add_scenario(*check_command, options->scenario)->required();
  add_seed(*check_command, options->scenario);
  check_command->add_option("--packets", options->packets, "packets offered to each link [1000000]")
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{1'000'000'000}));
  check_command->add_flag("--json", options->json, "print one JSON object");
  check_command->callback([options, &action] { action = [options] { return check(*options); }; });

  CLI::App* const export_command = netem.add_subcommand(
      "export-tc",
      "Print the tc commands that make the Linux kernel's netem impair packets like a scenario's "
      "links, and, as comments, unsupported settings with the reason");
  add_scenario(*export_command, options->scenario)->required();
  export_command->add_option("--interface", options->interface, "network interface [eth0]")
      ->check([](const std::string& name) {
        const bool fits = !name.empty() && name.size() < 16 &&
                          name.find_first_not_of(
                              "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
                              "0123456789._@:-") == std::string::npos;
        return fits ? std::string{}
                    : "must be an interface's name: 1 to 15 letters, digits, '.', '_', ':', '@' or "
                      "'-'";
      });
  export_command->callback(
      [options, &action] { action = [options] { return export_tc_commands(*options); }; });
}

}  // namespace tether
