#include "common/program/cli.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <stdexcept>
#include <string>

#include "common/base/errors.hpp"
#include "common/base/say.hpp"
#include "common/base/text.hpp"
#include "common/program/manual.hpp"
#include "common/version.hpp"

namespace tether {

namespace {

/// CLI11's error in the format of other errors, with the --help to read.
std::string in_our_words(const CLI::App* app, const CLI::Error& error) {
  std::string whole = app->get_name();
  for (const auto* sub = app; !sub->get_subcommands().empty();) {
    sub = sub->get_subcommands().front();
    whole += " " + sub->get_name();
  }
  return fmt::format("{}: error: {}; see {} --help\n", app->get_name(), error.what(), whole);
}

}  // namespace

int run_cli(CLI::App& app, int argc, char** argv, const std::function<int()>& body) {
  const auto complain = [&app](const char* what) {
    std::fflush(stdout);
    say(Severity::error, fmt::format("{}: error: {}", app.get_name(), printable_message(what)));
  };
  try {
    app.parse(argc, argv);
    const int code = body();
    if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0) {
      throw std::runtime_error("cannot write to standard output");
    }
    return code;
  } catch (const CLI::ParseError& error) {
    app.failure_message(in_our_words);
    return app.exit(error) == 0 ? kExitOk : kExitUsage;
  } catch (const UsageError& error) {
    complain(error.what());
    return kExitUsage;
  } catch (const std::invalid_argument& error) {
    complain(error.what());
    return kExitUsage;
  } catch (const std::exception& error) {
    complain(error.what());
    return kExitFailed;
  }
}

void add_about(CLI::App& app) {
  app.set_version_flag("--version", fmt::format("{} {}", app.get_name(), kVersion));
  // Ends the parsing as --version does, whatever else is required.
  const auto print = [](const std::string& text) { throw CLI::CallForVersion(text, 0); };
  app.add_flag_callback(
      "--man", [&app, print] { print(manual_page(app)); }, "Print the manual page: | man -l -");
  app.add_option_function<std::string>(
         "--completion",
         [&app, print](const std::string& shell) { print(completion_script(app, shell)); },
         "Print the completion script for a shell")
      ->check(CLI::IsMember({"bash", "zsh"}))
      ->trigger_on_parse();
}

void add_examples(CLI::App& command, const std::vector<std::string>& lines) {
  const std::string before = command.get_footer();
  command.footer(fmt::format("{}Examples:\n  {}", before.empty() ? "" : before + "\n\n",
                             fmt::join(lines, "\n  ")));
}

}  // namespace tether
