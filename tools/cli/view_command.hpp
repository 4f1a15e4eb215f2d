#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "tools/view/server/view_server.hpp"
#include "tools/view/sources/run_json.hpp"

namespace tether {

/// Where a view is to be had, as the command line says.
struct ViewOptions {
  std::string address = "127.0.0.1";
  std::uint16_t port = 8765;
  std::string token;
  std::vector<std::string> origins;
  std::string page;

  /// The same, for another `tether view`.
  std::vector<std::string> arguments() const;
  /// For a server of what `run` describes. Throws UsageError for an invalid token.
  ViewServer::Options server(const RunDescription& run) const;
};

/// Where the build, or an installation, puts the page: beside the folder of the programs.
std::filesystem::path shared_page();

/// Adds --address, --port, --token, --allow-origin and --page; `needs` may be null.
void add_view_options(CLI::App& command, ViewOptions& options, CLI::Option* needs);

/// Says on standard error where it is.
void announce(const ViewServer& server);

}  // namespace tether
