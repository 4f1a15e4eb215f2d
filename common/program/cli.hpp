#pragma once

#include <functional>
#include <string>
#include <vector>

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
