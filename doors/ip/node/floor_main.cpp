#include <fcntl.h>
#include <fmt/format.h>
#include <sched.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <csignal>
#include <fstream>
#include <iostream>
#include <string>
#include <thread>
#include <vector>

#include "common/base/errors.hpp"
#include "common/base/share.hpp"
#include "common/program/cli.hpp"
#include "doors/ip/node/floor_state.hpp"

namespace {

using namespace tether;
using std::chrono::milliseconds;

/// Replaces this process by a program.
[[noreturn]] void become(const std::vector<std::string>& command) {
  std::vector<char*> argv;
  for (const std::string& word : command) argv.push_back(const_cast<char*>(word.c_str()));
  argv.push_back(nullptr);
  execvp(argv.front(), argv.data());
  const int code = errno == ENOENT ? 127 : 126;
  std::cerr << "tether-floor: error: cannot run " << command.front() << '\n';
  _exit(code);
}

int exit_code_of(int status) {
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

int up(const std::filesystem::path& folder, const std::vector<std::string>& arguments) {
  if (ip::floor_process(folder)) throw ip::already_up(folder);
  const auto log = std::filesystem::path(folder.string() + ".log");
  const pid_t tun = check_system_call("starting tether-tun", fork());
  if (tun == 0) {
    setsid();
    const int out = open(log.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW, 0600);
    const int in = open("/dev/null", O_RDONLY);
    dup2(in, 0);
    dup2(out, 1);
    dup2(out, 2);
    std::vector<std::string> command{(executable_folder() / "tether-tun").string(), "--floor",
                                     folder.string()};
    command.insert(command.end(), arguments.begin(), arguments.end());
    become(command);
  }
  std::vector<ip::HostEntry> hosts;
  while ((hosts = ip::read_hosts(folder)).empty()) {
    int status = 0;
    if (waitpid(tun, &status, WNOHANG) == tun) {
      std::cerr << std::ifstream(log).rdbuf();
      std::filesystem::remove(log);
      return exit_code_of(status) == 0 ? kExitFailed : exit_code_of(status);
    }
    std::this_thread::sleep_for(milliseconds{10});
  }
  for (const ip::HostEntry& host : hosts) fmt::print("{:<15} {}\n", host.address, host.name);
  return kExitOk;
}

void join(pid_t host, const char* kind, bool may_be_own) {
  const std::string file = fmt::format("/proc/{}/ns/{}", host, kind);
  const int fd = check_system_call("opening " + file, open(file.c_str(), O_RDONLY | O_CLOEXEC));
  const int result = setns(fd, 0);
  const bool is_own = result != 0 && errno == EINVAL && may_be_own;
  close(fd);
  if (!is_own) check_system_call("joining " + file, result);
}

int exec(const std::filesystem::path& folder, const std::string& name,
         const std::vector<std::string>& command) {
  const auto hosts = ip::read_hosts(folder);
  if (hosts.empty()) {
    throw UsageError(
        fmt::format("no floor is up in {}: run `tether floor up SCENARIO` first", folder.string()));
  }
  const auto found = std::find_if(hosts.begin(), hosts.end(),
                                  [&](const ip::HostEntry& host) { return host.name == name; });
  if (found == hosts.end()) {
    std::string names;
    for (const ip::HostEntry& host : hosts) names += (names.empty() ? "" : ", ") + host.name;
    throw UsageError(fmt::format("no host \"{}\" is on the floor; there are {}", name, names));
  }
  const std::string here = std::filesystem::current_path().string();
  const pid_t host = found->process;
  // The mounts last: their /proc does not show the host by this number.
  if (geteuid() != 0) join(host, "user", false);
  join(host, "net", false);
  join(host, "pid", false);
  join(host, "mnt", false);
  if (chdir(here.c_str()) != 0) check_system_call("entering /", chdir("/"));
  const pid_t child = check_system_call("starting a process", fork());
  if (child == 0) become(command);
  for (const int signal : {SIGINT, SIGQUIT}) std::signal(signal, SIG_IGN);  // NOLINT(cert-err33-c)
  static pid_t forward_to = 0;
  forward_to = child;
  std::signal(SIGTERM, [](int signal) { kill(forward_to, signal); });  // NOLINT(cert-err33-c)
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  return exit_code_of(status);
}

/// The kernel removes devices and namespaces when tether-tun ends, and ends what runs on hosts.
int down(const std::filesystem::path& folder) {
  constexpr int kTries = 500;
  for (int i = 0; i < kTries; ++i) {
    const auto tun = ip::floor_process(folder);
    if (!tun) break;
    if (i == 0) kill(*tun, SIGTERM);
    if (i == kTries / 2) kill(*tun, SIGKILL);
    std::this_thread::sleep_for(milliseconds{20});
  }
  if (ip::floor_process(folder)) throw std::runtime_error("tether-tun does not end");
  ip::remove_floor_folder(folder);
  std::filesystem::remove(folder.string() + ".log");
  return kExitOk;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Hosts of a control room and vehicles on this machine, for any IP program",
               "tether-floor");
  add_about(app);
  app.require_subcommand(1);
  std::string folder = ip::default_floor_folder().string(), host;
  app.add_option("--floor", folder,
                 "folder of the running floor's state [$XDG_RUNTIME_DIR/tether-floor]");
  CLI::App* const up_command =
      app.add_subcommand("up",
                         "Start tether-tun in the background with these arguments: a "
                         "scenario, --set, --lcm-url, --mtu, --record");
  std::vector<std::string> arguments, command;
  up_command->prefix_command();
  CLI::App* const exec_command =
      app.add_subcommand("exec", "Run a program on a host; its exit code is the program's");
  exec_command->add_option("host", host, "control, or a vehicle's name")->required();
  exec_command->add_option("command", command, "program and its arguments, after --")->required();
  CLI::App* const down_command =
      app.add_subcommand("down", "End the floor, and all that runs on its hosts");
  add_examples(*up_command, {"tether floor up scenarios/paper.toml"});
  add_examples(*exec_command, {"tether floor exec AGV -- ping -c 3 control"});
  add_examples(*down_command, {"tether floor down"});
  add_examples(
      app, {"tether floor up scenarios/paper.toml", "tether floor exec control -- iperf3 -s -1 &",
            "tether floor exec AGV -- iperf3 -c control"});
  return run_cli(app, argc, argv, [&] {
    if (app.got_subcommand(up_command)) return up(folder, up_command->remaining());
    if (app.got_subcommand(down_command)) return down(folder);
    return exec(folder, host, command);
  });
}
