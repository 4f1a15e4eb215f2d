#include "common/program/cli.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <stdexcept>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "common/version.hpp"

namespace tether {

int run_cli(CLI::App& app, int argc, char** argv, const std::function<int()>& body) {
  const auto complain = [&app](const char* what) {
    std::fflush(stdout);
    fmt::print(stderr, "{}: error: {}\n", app.get_name(), printable_message(what));
  };
  try {
    app.parse(argc, argv);
    const int code = body();
    if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0) {
      throw std::runtime_error("cannot write to standard output");
    }
    return code;
  } catch (const CLI::ParseError& error) {
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

void add_version(CLI::App& app) {
  app.set_version_flag("--version", fmt::format("{} {}", app.get_name(), kVersion));
}

}  // namespace tether
