#include "tools/base/examples.hpp"

#include <CLI/CLI.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "common/program/cli.hpp"

namespace tether {
namespace {

struct CommandExamples {
  const char* command;  ///< its words after the program
  std::vector<std::string> lines;
};

const std::vector<CommandExamples>& all_examples() {  // NOLINT(readability-function-size): a table
  static const std::vector<CommandExamples> kAll{
      {"run",
       {"tether run scenarios/paper.toml --set channel.prr=0.45 --out out/paper",
        "tether run scenarios/paper.toml --view --speed 4", "tether run --keys"}},
      {"sweep",
       {"tether sweep experiments/f2_prr.toml --quick --report",
        "tether sweep experiments/f2_prr.toml --dry-run",
        "tether sweep experiments/f2_prr.toml --out shards --shard 1/3"}},
      {"sweep export",
       {"tether sweep export out/f2_prr --out runs.csv", "tether sweep export out/f2_prr --means"}},
      {"sweep scenario", {"tether sweep scenario out/f2_prr 4 17 --out again.toml"}},
      {"tune",
       {"tether tune experiments/gains/tune.toml --quick",
        "tether tune experiments/gains/tune.toml --law \"PID, 1/1 Hz\" --keep "
        "experiments/gains/tuned.toml"}},
      {"predict",
       {"tether predict out/f2_prr --out f2.prediction.json",
        "tether predict --check f2.prediction.json out/f2_measured"}},
      {"merge", {"tether merge shards --out merged"}},
      {"report", {"tether report out/f2_prr", "tether report out/f5_risk --risk now"}},
      {"reproduce", {"tether reproduce --quick", "tether reproduce --set vehicle.plant=kinematic"}},
      {"live",
       {"tether live scenarios/paper.toml --set channel.prr=0.45 --out out/live",
        "tether live scenarios/paper.toml --view --duration 20"}},
      {"view",
       {"tether view", "tether view out/paper/run.lcmlog",
        "tether view --scenario scenarios/paper.toml --port 0"}},
      {"spy", {"tether spy"}},
      {"echo",
       {"tether echo 'CTRL/(POSE|CMD_VEL)' --count 2", "tether echo --quiet --duration 10"}},
      {"record",
       {"tether record . --channels 'CTRL/.*|AGV/.*'", "tether record . --file-mb 100 --files 10"}},
      {"metrics",
       {"tether metrics",
        "tether metrics --address 0.0.0.0 --token 0123456789abcdef0123456789abcdef"}},
      {"lcm-route", {"tether lcm-route", "tether lcm-route --remove"}},
      {"can-links", {"tether can-links --socket can-links"}},
      {"log",
       {"tether log info out/paper/run.lcmlog", "tether log csv out/paper/run.lcmlog CTRL/POSE"}},
      {"log info", {"tether log info out/paper/run.lcmlog"}},
      {"log csv",
       {"tether log csv out/paper/run.lcmlog CTRL/POSE",
        "tether log csv out/paper/run.lcmlog --out csv"}},
      {"log mcap",
       {"tether log mcap out/paper/run.lcmlog", "tether log mcap out/paper/run.lcmlog --ros2"}},
      {"log page", {"tether log page out/paper/run.lcmlog --from 10 --to 40 --out part.html"}},
      {"can import", {"tether can import drive.eds --node 1 --node 2 > mine.toml"}},
      {"can",
       {"tether can probe --interface can0 --node 1 --node 2", "tether can status",
        "tether can arm"}},
      {"can arm", {"tether can arm", "tether can arm --vehicle AGV7"}},
      {"can disarm", {"tether can disarm"}},
      {"can estop", {"tether can estop"}},
      {"can release", {"tether can release"}},
      {"can reset", {"tether can reset"}},
      {"can hold", {"tether can hold"}},
      {"can drive", {"tether can drive --v-mps 0.1 --for-s 10"}},
      {"can inject",
       {"tether can inject reboot --node 2", "tether can inject wheel_slip --node 1 --value 0.3",
        "tether can inject none"}},
      {"can status", {"tether can status"}},
      {"can probe",
       {"tether can probe --interface can0 --scan",
        "tether can probe --interface can0 --drivetrain my_drivetrain.toml"}},
      {"can commission",
       {"tether can commission my_agv.toml --operator \"A. Smith\" --wheels-free",
        "tether can commission my_agv.toml --operator \"A. Smith\" --on-the-floor"}},
      {"netem",
       {"tether netem check scenarios/paper.toml --set channel.prr=0.8",
        "tether netem set downlink.prr=0.45", "tether netem fit capture.csv"}},
      {"netem fit",
       {"tether netem fit out/paper/run.lcmlog --channel CTRL/POSE --link uplink",
        "tether netem fit monday/control-wifi.csv --out floor.toml"}},
      {"netem import",
       {"tether netem import ping.txt --out trace.csv",
        "tether netem import measured.csv --time stamp:ns --delay rtt:ms --round-trip"}},
      {"netem set",
       {"tether netem set prr=0.45 downlink.delay_ms=30",
        "tether netem set model=markov markov.p_bad=0.25 markov.mean_cycle_s=8"}},
      {"netem show", {"tether netem show"}},
      {"netem check",
       {"tether netem check scenarios/paper.toml --set channel.prr=0.8 --packets 100000"}},
      {"netem export-tc",
       {"tether netem export-tc scenarios/paper.toml --set channel.delay_ms=50 --interface wlan0"}},
      {"netem plot",
       {"tether netem plot scenarios/paper.toml --set channel.jitter.law=gamma "
        "--set channel.jitter.mean_ms=30 --set channel.jitter.sd_ms=20 --out out/gamma"}},
      {"doctor", {"tether doctor", "tether doctor --can can0"}},
      {"margin",
       {"tether margin scenarios/paper.toml --set controller.law=tracking --set "
        "sensor.rate_hz=20"}},
      {"path",
       {"tether path scenarios/paper.toml --period 1",
        "echo 12.5 | tether path scenarios/paper.toml --ask"}},
  };
  return kAll;
}

}  // namespace

void add_command_examples(CLI::App& app) {
  for (const CommandExamples& examples : all_examples()) {
    CLI::App* command = &app;
    std::istringstream words(examples.command);
    for (std::string word; command != nullptr && words >> word;) {
      const auto found =
          command->get_subcommands([&](const CLI::App* sub) { return sub->check_name(word); });
      command = found.empty() ? nullptr : found.front();
    }
    if (command == nullptr) continue;
    std::vector<std::string> lines = examples.lines;
    for (std::string& line : lines) {
      if (line.starts_with("tether ")) line.replace(0, 6, app.get_name());
    }
    add_examples(*command, lines);
  }
}

}  // namespace tether
