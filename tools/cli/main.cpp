#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <string>
#include <vector>

#include "common/base/nearest_name.hpp"
#include "common/base/share.hpp"
#include "common/base/text.hpp"
#include "common/program/cli.hpp"
#include "tools/base/examples.hpp"
#include "tools/base/process.hpp"
#include "tools/cli/commands.hpp"
#include "tools/cli/netem/netem_commands.hpp"

namespace {

/// `tether X …` is `tether-X …` where a program of that name lies beside this one.
void become_sibling(int argc, char** argv) {
  if (argc < 2 || argv[1][0] == '-') return;
  const std::string sibling =
      (tether::executable_folder() / ("tether-" + std::string(argv[1]))).string();
  std::vector<std::string> command(argv + 1, argv + argc);
  command.front() = sibling;
  if (access(sibling.c_str(), X_OK) == 0) execv(sibling.c_str(), tether::to_argv(command).data());
}

/// `tether netem fit …` and its like are this program's own, and so is their help; `tether netem
/// SCENARIO …` is the node.
bool is_own_subcommand(const CLI::App& command, const std::string& word) {
  const auto is_named = [&](const CLI::App* sub) { return sub->check_name(word); };
  return word.empty() || word == "-h" || word == "--help" ||
         !command.get_subcommands(is_named).empty();
}

bool may_be_a_file(const std::string& word) {
  return word.find_first_of("-./") != std::string::npos || access(word.c_str(), F_OK) == 0;
}

int refuse(const CLI::App& command, const std::string& word) {
  std::vector<std::string> names;
  for (const CLI::App* sub : command.get_subcommands({})) names.push_back(sub->get_name());
  std::string whole = "tether";
  if (command.get_parent() == nullptr) {
    names.insert(names.end(), {"sim", "controller", "localiser", "link", "can-bridge", "can-drive",
                               "tun", "floor"});
  } else {
    whole += " " + command.get_name();
  }
  std::fprintf(
      stderr,
      "tether: error: there is no command \"%s %s\" (did you mean \"%s\"?); see %s --help\n",
      whole.c_str(), tether::printable(word, tether::kLongestNameShown).c_str(),
      tether::nearest_name(names, word).c_str(), whole.c_str());
  return tether::kExitUsage;
}

}  // namespace

int main(int argc, char** argv) {
  using namespace tether;
  CLI::App app("Tether: how much delay and loss does a remotely controlled AGV survive?", "tether");
  add_about(app);
  app.require_subcommand(1);
  Action action;
  add_run_command(app, action);
  add_sweep_command(app, action);
  add_tune_command(app, action);
  add_predict_command(app, action);
  add_merge_command(app, action);
  add_report_command(app, action);
  add_reproduce_command(app, action);
  add_live_command(app, action);
  add_view_command(app, action);
  add_spy_command(app, action);
  add_echo_command(app, action);
  add_record_command(app, action);
  add_metrics_command(app, action);
  add_lcm_route_command(app, action);
  add_can_links_command(app, action);
  add_log_command(app, action);
  add_can_command(app, action);
  add_netem_command(app, action);
  add_doctor_command(app, action);
  add_margin_command(app, action);
  add_path_command(app, action);
  app.footer(
      "Also: tether sim, netem, controller, localiser, can-bridge and can-drive, the nodes of a "
      "live run; tether link carries channels between hosts; tether floor runs any IP program on "
      "the emulated network.");
  add_command_examples(app);
  add_examples(app,
               {"tether run scenarios/paper.toml --out out/paper     # one run, and its picture",
                "tether run scenarios/paper.toml --view              # in the browser",
                "tether doctor                                       # what this machine lacks"});
  const std::string word = argc > 1 ? argv[1] : "", next = argc > 2 ? argv[2] : "";
  const auto found =
      app.get_subcommands([&](const CLI::App* sub) { return sub->check_name(word); });
  if (found.empty() || !is_own_subcommand(*found.front(), next)) {
    const bool has_commands = !found.empty() && !found.front()->get_subcommands({}).empty();
    if (has_commands && !may_be_a_file(next)) return refuse(*found.front(), next);
    become_sibling(argc, argv);
    if (found.empty() && !word.empty() && word[0] != '-') return refuse(app, word);
  }
  return run_cli(app, argc, argv, [&action] { return action(); });
}
