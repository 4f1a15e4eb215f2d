#include <fmt/format.h>
#include <sodium.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <string>

#include "common/lcm/lcm_url.hpp"
#include "common/lcm/udpm_bus.hpp"
#include "common/node/message_io.hpp"
#include "common/node/real_time_loop.hpp"
#include "common/program/cli.hpp"
#include "common/program/service_manager.hpp"
#include "doors/link/key_file.hpp"
#include "doors/link/node/link_node.hpp"
#include "doors/link/node/recording.hpp"

namespace {

using namespace tether;

link::Key random_key() {
  link::Key key{};
  randombytes_buf(key.data(), key.size());
  return key;
}

int keygen(const std::string& file) {
  const link::KeyPair pair = link::key_pair_of(random_key());
  link::write_key_file(file, pair);
  fmt::print("{}\n", link::key_text(pair.public_key));
  return kExitOk;
}

int show(const std::string& file) {
  fmt::print("{}\n", link::key_text(link::read_key_file(file).public_key));
  return kExitOk;
}

int run(const std::string& file) {
  const link::LinkConfig config = link::load_link_config(file);
  const link::KeyPair own = link::read_key_file(config.key_file);
  RealTimeLoop loop(RealTimeLoop::wall_utime_us());
  UdpmBus bus(config.lcm_url, loop);
  const auto say = [](Severity severity, const std::string& line) {
    tether::say(severity, "tether-link: " + line);
  };
  link::LinkNode node(config, own, loop, bus, random_key, say);
  say(Severity::info, "running, on " + config.lcm_url);
  ServiceManager manager(loop);
  manager.ready("running on " + config.lcm_url);
  loop.run();
  manager.stopping();
  node.finish();
  return kExitOk;
}

struct RecordOptions {
  link::RecordSettings settings;
  std::string lcm_url = kDefaultLcmUrl;
  double seconds = 0.0;
};

int record(const RecordOptions& options) {
  RealTimeLoop loop(RealTimeLoop::wall_utime_us());
  UdpmBus bus(options.lcm_url, loop);
  link::Recording recording(options.settings);
  std::int64_t undecodable = 0;
  subscribe<path_fates_t>(bus, link::kFatesChannel, kDeepQueue, undecodable,
                          [&](const path_fates_t& fates) { recording.take(fates); });
  if (options.seconds > 0.0) {
    loop.at(loop.now() + from_seconds(options.seconds), Priority::observer,
            [&loop](Instant) { loop.stop(); });
  }
  loop.run();
  const std::string summary = recording.summary();
  fmt::print("{}", summary);
  if (!summary.empty()) return kExitOk;
  say(Severity::error,
      fmt::format("tether-link: nothing was heard on {} of {}: does tether-link run there, with a "
                  "peer that is up and does not defer copies?",
                  link::kFatesChannel, options.lcm_url));
  return kExitFailed;
}

}  // namespace

// LCM ──▶ tether-link ═══ authenticated UDP, by one path or two ═══▶ tether-link ──▶ LCM
int main(int argc, char** argv) {
  CLI::App app("Carries chosen LCM channels between hosts: authenticated, by two paths at once",
               "tether-link");
  add_about(app);
  app.require_subcommand(1);
  std::string file;
  const auto add = [&](const char* name, const char* what, const char* which) {
    CLI::App* const command = app.add_subcommand(name, what);
    command->add_option("file", file, which)->required();
    return command;
  };
  add("keygen", "Make a pair of keys, and print the public one for the other hosts' files",
      "key file to write, of mode 0600; never overwrites");
  add("show", "Print the public key of a key file", "key file");
  add("run", "Carry channels until Ctrl-C", "configuration (TOML): docs/howto/link.md");
  RecordOptions recorded;
  CLI::App* const record_command = app.add_subcommand(
      "record",
      "Record the fates of the peers' datagrams until Ctrl-C: PEER-PATH.csv for `tether netem "
      "fit` and the channel's trace model");
  record_command
      ->add_option("--lcm-url", recorded.lcm_url, "LCM network of this host's tether-link")
      ->envname("LCM_DEFAULT_URL")
      ->capture_default_str();
  record_command->add_option("--out", recorded.settings.folder, "folder, which must exist [.]");
  record_command->add_option("--peer", recorded.settings.peer, "record only this peer [all]");
  record_command->add_option("--seconds", recorded.seconds, "recording time, s [until Ctrl-C]")
      ->check(number_between(0.1, 1e7));
  record_command->add_flag("--same-clock", recorded.settings.same_clock,
                           "the peer's clock is synchronised with this host's (PTP, or one host): "
                           "delays are differences of stamps, not intervals");
  add_examples(*app.get_subcommand("keygen"), {"tether-link keygen control.key"});
  add_examples(*app.get_subcommand("show"), {"tether-link show control.key"});
  add_examples(*app.get_subcommand("run"), {"tether-link run control.toml"});
  add_examples(*record_command, {"tether-link record --out monday",
                                 "tether-link record --peer vehicle7 --seconds 600"});
  add_examples(app, {"tether-link keygen control.key", "tether-link run control.toml"});
  return run_cli(app, argc, argv, [&]() -> int {
    if (app.got_subcommand(record_command)) return record(recorded);
    if (sodium_init() < 0) throw std::runtime_error("libsodium does not start");
    if (app.got_subcommand("keygen")) return keygen(file);
    return app.got_subcommand("show") ? show(file) : run(file);
  });
}
