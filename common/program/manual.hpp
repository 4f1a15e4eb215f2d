#pragma once

#include <string>

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

}  // namespace tether
