#include "tools/cli/view_options.hpp"

#include <fmt/format.h>

#include "common/base/errors.hpp"
#include "common/base/share.hpp"
#include "common/base/text.hpp"
#include "common/program/cli_range.hpp"
#include "tools/base/process.hpp"
#include "tools/view/web/access.hpp"

namespace tether {
namespace {

void check_origin(const std::string& origin) {
  if (is_origin(origin)) return;
  throw UsageError(fmt::format(
      "--allow-origin \"{}\": has to be what browsers call an origin, scheme://host or "
      "scheme://host:port in lower case and without a path: such as https://app.foxglove.dev",
      printable(origin, kLongestNameShown)));
}

}  // namespace

std::filesystem::path shared_page() { return shared_file("view"); }

std::vector<std::string> ViewOptions::arguments() const {
  std::vector<std::string> all{"--address=" + address, fmt::format("--port={}", port)};
  if (!token.empty()) all.push_back("--token=" + token);
  for (const std::string& origin : origins) all.push_back("--allow-origin=" + origin);
  if (!page.empty()) all.push_back("--page=" + page);
  return all;
}

ViewServer::Options ViewOptions::server(const RunDescription& run) const {
  if (!token.empty()) check_token(token);
  for (const std::string& origin : origins) check_origin(origin);
  ViewServer::Options server;
  server.address = address;
  server.port = port;
  server.token = token;
  server.origins = origins;
  server.page = page.empty() ? shared_page() : std::filesystem::path(page);
  server.title = "tether: " + run.source;
  server.publishable = run.publishable;
  server.has_time = run.kind != "live";
  server.run_json = run_json(run);
  return server;
}

void add_view_options(CLI::App& command, ViewOptions& options, CLI::Option* needs) {
  const std::vector<CLI::Option*> all{
      command
          .add_option("--address", options.address,
                      "IP address that the view listens on; addresses other than this host's own "
                      "(127.0.0.1, ::1) require --token")
          ->capture_default_str(),
      command.add_option("--port", options.port, "port of the view; 0: any free port")
          ->check(CLI::Range(0, 65535))
          ->capture_default_str(),
      command.add_option("--token", options.token, "access token, 16 characters or more [none]"),
      command.add_option("--allow-origin", options.origins,
                         "origin of an external page that may use the view, such as "
                         "https://app.foxglove.dev (repeatable) [none]"),
      command.add_option("--page", options.page,
                         "folder with the page's files [share/tether/view beside bin]")};
  if (needs == nullptr) return;
  for (CLI::Option* const option : all) option->needs(needs);
}

void announce(const ViewServer& server) {
  fmt::print(stderr, "tether: view at {}{}\n", server.address(),
             server.is_everywhere() ? " from here; from elsewhere by an address of this host" : "");
}

}  // namespace tether
