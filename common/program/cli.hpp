#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string>
#include <vector>

namespace CLI {  // NOLINT(readability-identifier-naming)
class App;
}

namespace tether {

/// The manual page, section 1, of a program and all its subcommands: what `--help` says, in the
/// form of man(7).
std::string manual_page(const CLI::App& app);

/// A script for bash, or a function for zsh (which runs the one for bash), that completes
/// subcommands, options, and values where there is a choice; files elsewhere, and scenario keys
/// after `--set` if the program lists them with `run --keys`. `shell` is "bash" or "zsh"; else a
/// UsageError.
std::string completion_script(const CLI::App& app, const std::string& shell);

/// CLI::Range for numbers, which also refuses NaN: that is neither below nor above anything.
inline CLI::Validator number_between(double low, double high) {
  CLI::Validator range = CLI::Range(low, high);
  return range & CLI::Validator(
                     [](std::string& text) {
                       return CLI::detail::to_lower(text).find("nan") == std::string::npos
                                  ? std::string{}
                                  : "Value " + text + " is not a number";
                     },
                     "");
}

}  // namespace tether

namespace CLI {  // NOLINT(readability-identifier-naming)
class App;
}

namespace tether {

/// Exit codes of all programs.
enum ExitCode : int { kExitOk = 0, kExitFailed = 1, kExitUsage = 2 };

/// Parses the command line and runs `body`, which returns the exit code. Anything wrong with the
/// command line, every UsageError, and std::invalid_argument (a configuration that a component
/// refuses) exits with kExitUsage; other exceptions, and output that cannot be written, with
/// kExitFailed; both after one message on stderr.
int run_cli(CLI::App& app, int argc, char** argv, const std::function<int()>& body);

/// `--version`, `--man` and `--completion bash|zsh` (manual.hpp): each prints and ends the program.
void add_about(CLI::App& app);

/// "Examples:" and a line each at the end of the help. After the command's own footer and
/// subcommands, which inherit footers.
void add_examples(CLI::App& command, const std::vector<std::string>& lines);

}  // namespace tether
