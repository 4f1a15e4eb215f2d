#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <memory>
#include <string>

#include "common/base/say.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/lcm/udpm_bus.hpp"
#include "common/node/bus.hpp"
#include "common/node/real_time_loop.hpp"
#include "common/program/cli.hpp"
#include "common/program/service_manager.hpp"
#include "tools/cli/vehicle/vehicle_commands.hpp"
#include "tools/messages/rotating_log.hpp"

namespace tether {
namespace {

struct RecordOptions {
  std::string folder;
  std::string name = "floor";
  std::string channel_regex = ".*";
  std::string lcm_url = kDefaultLcmUrl;
  double file_mb = 1000.0;
  std::uint64_t files = 20;
  double keep_free_mb = 1000.0;
};

std::uint64_t megabytes(double count) { return static_cast<std::uint64_t>(count * 1e6); }

int record(const RecordOptions& options) {
  RealTimeLoop loop(RealTimeLoop::wall_utime_us());
  const std::unique_ptr<Bus> bus = open_bus(options.lcm_url, loop);
  RotatingLog log({.folder = options.folder,
                   .name = options.name,
                   .file_bytes = megabytes(options.file_mb),
                   .files = options.files,
                   .keep_free_bytes = megabytes(options.keep_free_mb)});
  std::int64_t lost = 0;  // state of the last second
  bus->subscribe(options.channel_regex, kDeepQueue,
                 [&log](const Message& m) { log.write(m.channel, m.bytes, m.received_utime); });
  ServiceManager manager(loop);
  loop.every(loop.now(), std::chrono::seconds{1}, Priority::observer, [&](Instant) {
    const bool loses = log.lost() > lost;
    lost = log.lost();
    log.flush();
    if (loses) {
      const std::string text =
          fmt::format("{} messages are not recorded: less than {:.0f} MB free in {}", lost,
                      options.keep_free_mb, options.folder);
      say(Severity::warning, text);
      manager.status(text);
    } else {
      manager.status(fmt::format("{} messages in {}", log.written(), log.file().string()));
    }
  });
  manager.ready("recording in " + options.folder);
  loop.run();
  manager.stopping();
  log.flush();
  say(Severity::info,
      fmt::format("{} messages recorded, {} lost for want of room", log.written(), log.lost()));
  return log.lost() > 0 ? kExitFailed : kExitOk;
}

}  // namespace

void add_record_command(CLI::App& tether, Action& action) {
  auto options = std::make_shared<RecordOptions>();
  CLI::App* const command = tether.add_subcommand(
      "record", "Record the newest LCM messages in a bounded set of files NAME-00000001.lcmlog …");
  command->add_option("folder", options->folder, "existing folder of the files")->required();
  command->add_option("--name", options->name, "first part of their names")
      ->check(CLI::Validator(
          [](const std::string& text) {
            return text.empty() || text.find('/') != std::string::npos ? "a name without '/'" : "";
          },
          "NAME"))
      ->capture_default_str();
  command
      ->add_option("--channels", options->channel_regex,
                   "channels to record: a regular expression (RE2) for the whole name")
      ->capture_default_str();
  command->add_option("--file-mb", options->file_mb, "size at which the next file begins, MB")
      ->check(number_between(0.001, 1e6))
      ->capture_default_str();
  command->add_option("--files", options->files, "maximum number of files; the oldest is deleted")
      ->check(CLI::Range(2, 100000))
      ->capture_default_str();
  command
      ->add_option("--keep-free-mb", options->keep_free_mb,
                   "free space to keep on the file system, MB: old files are deleted first, then "
                   "messages are dropped, counted and reported")
      ->check(number_between(0.0, 1e9))
      ->capture_default_str();
  command->add_option("--lcm-url", options->lcm_url, "LCM network")
      ->envname("LCM_DEFAULT_URL")
      ->capture_default_str();
  command->callback([options, &action] { action = [options] { return record(*options); }; });
}

}  // namespace tether
