#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>
#include <system_error>
#include <vector>

#include "common/base/errors.hpp"
#include "common/base/share.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/program/cli.hpp"
#include "tools/base/process.hpp"
#include "tools/cli/commands.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;

std::string environment(const char* name) {
  const char* const value = std::getenv(name);
  return value == nullptr ? "" : value;
}

[[noreturn]] void missing(const std::string& what, const std::string& package) {
  throw std::runtime_error(
      fmt::format("{} is missing; on Debian: sudo apt-get install {}", what, package));
}

/// The `java` that execvp() would find.
fs::path find_java() {
  fs::path java = find_program("java");
  if (java.empty()) missing("java", "default-jre");
  return java;
}

/// Debian's "headless" Java runs programs, but opens no windows.
void check_can_open_windows(const fs::path& java) {
  std::error_code error;
  const fs::path libraries = fs::canonical(java, error).parent_path().parent_path() / "lib";
  if (!error && fs::exists(libraries / "libawt.so") && !fs::exists(libraries / "libawt_xawt.so")) {
    missing(fmt::format("the graphical part of Java ({} is headless)", java.string()),
            "default-jre");
  }
}

std::string find_jar(const std::string& name, const std::string& package) {
  for (const char* folder : {"/usr/share/java", "/usr/local/share/java"}) {
    const fs::path jar = fs::path(folder) / name;
    if (fs::exists(jar)) return jar.string();
  }
  missing(fmt::format("/usr/share/java/{}", name), package);
}

/// Replaces this process by lcm-spy. Debian's own start script fails on Java 17, which no longer
/// knows -Xincgc.
int spy(const std::string& lcm_url) {
  const std::string url = checked_lcm_url(lcm_url);
  const fs::path java = find_java();
  check_can_open_windows(java);
  const std::string types = shared_file("java/tether-lcmtypes.jar").string();
  const std::string class_path = fmt::format("{}:{}:{}", find_jar("lcm.jar", "liblcm-java"),
                                             find_jar("jchart2d.jar", "libjchart2d-java"), types);
  if (environment("DISPLAY").empty()) {
    throw std::runtime_error(
        "no display (DISPLAY is not set); over ssh use ssh -X, without any display use tether "
        "echo");
  }
  // lcm-spy looks for types in the jars of CLASSPATH; the user's own may be there already.
  const std::string others = environment("CLASSPATH");
  const std::string types_path = others.empty() ? types : types + ":" + others;
  if (setenv("CLASSPATH", types_path.c_str(), 1) != 0) {
    throw std::system_error(errno, std::generic_category(), "setting CLASSPATH");
  }

  std::vector<std::string> words = {java.string(),     "-Djava.net.preferIPv4Stack=true",
                                    "-Xmx256m",        "-cp",
                                    class_path,        "lcm.spy.Spy",
                                    "--lcm-url=" + url};
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  execv(java.c_str(), arguments.data());
  throw std::system_error(errno, std::generic_category(), "starting " + java.string());
}

}  // namespace

void add_spy_command(CLI::App& tether, Action& action) {
  auto lcm_url = std::make_shared<std::string>(kDefaultLcmUrl);
  CLI::App* const command = tether.add_subcommand(
      "spy", "Open lcm-spy, LCM's own inspector, with the project's types (needs a display)");
  command->add_option("--lcm-url", *lcm_url, "LCM network")
      ->envname("LCM_DEFAULT_URL")
      ->capture_default_str();
  command->callback([lcm_url, &action] { action = [lcm_url] { return spy(*lcm_url); }; });
}

}  // namespace tether
