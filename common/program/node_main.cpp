#include "common/program/node_main.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <tether/clock_t.hpp>
#include <tether/presence_t.hpp>
#include <utility>
#include <vector>

#include "common/base/errors.hpp"
#include "common/base/say.hpp"
#include "common/base/text.hpp"
#include "common/fleet/fleet.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/lcm/lockstep_member.hpp"
#include "common/lcm/udpm_bus.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/message_io.hpp"
#include "common/node/real_time_loop.hpp"
#include "common/node/sole_sender.hpp"
#include "common/program/cli.hpp"
#include "common/program/loop_report.hpp"
#include "common/program/presence.hpp"
#include "common/program/service_manager.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {
namespace {

struct Options {
  std::string scenario_file;
  std::vector<std::string> overrides;
  std::string lcm_url = kDefaultLcmUrl;
  std::string control_lcm_url;
  std::optional<std::int64_t> start_utime_us;
  std::optional<std::int64_t> start_boot_ns;
  double speed = 1.0;
  std::optional<std::int64_t> lockstep_session;
  std::vector<std::string> expected_nodes;
  bool stands_alone = false;
  bool locks_memory = false;
};

constexpr Duration kClockPatience = std::chrono::seconds{2};
/// A clock that differs by more than this is another run's.
constexpr Duration kClockJump = std::chrono::milliseconds{500};
/// So many messages in a row must say so, because a single one may be a stray.
constexpr int kClockJumpMessages = 3;

/// Follows SIM/CLOCK: sets the loop's time at the first message, stops the loop at a jump.
class ClockFollower {
 public:
  ClockFollower(RealTimeLoop& loop, Bus& bus) : loop_(loop) {
    subscribe<clock_t>(bus, ChannelNames("AGV").clock, 1, undecodable_,
                       [this](const clock_t& m) { on_clock(from_utime(m.utime), m.run); });
  }

  /// Blocks until the first clock message; false if a signal came first. Says after 2 s what to do.
  bool wait(const std::string& name) {
    loop_.at(loop_.now() + kClockPatience, Priority::observer, [this, name](Instant) {
      if (following_) return;
      say(Severity::warning,
          fmt::format("{}: no SIM/CLOCK yet: start tether-sim, or without a simulator give "
                      "--start-utime",
                      name));
    });
    loop_.run();
    return following_;
  }
  bool jumped() const { return jumped_; }

 private:
  void on_clock(Instant now, std::int64_t run) {
    const Duration difference = now - loop_.now();
    if (!following_) {
      loop_.set_now(now, run);
      following_ = true;
      loop_.stop();
    } else if (run == loop_.run_id() && difference <= kClockJump && difference >= -kClockJump) {
      disagreements_ = 0;
    } else if (++disagreements_ >= kClockJumpMessages) {
      jumped_ = true;
      loop_.stop();
    }
  }

  RealTimeLoop& loop_;
  std::int64_t undecodable_ = 0;
  bool following_ = false;
  bool jumped_ = false;
  int disagreements_ = 0;
};

/// Channels on which operators and testers also send, in addition to the node that owns them in
/// simulated time.
ChannelOwners live_owners(const std::vector<Scenario>& members) {
  ChannelOwners owners = channel_owners(members);
  for (const Scenario& member : members) {
    const ChannelNames c(member.get<VehicleSettings>().name);
    for (const std::string& open : {c.net_set, c.can_request, c.can_inject}) owners.erase(open);
  }
  return owners;
}

/// A network on which a run's messages are taken from the programs that own their channels.
class RunNetwork {
 public:
  RunNetwork(const NodeProgram& program, const Options& options, const Scenario& scenario,
             const std::string& url, EventLoop& loop)
      : name_(program.name),
        senders_({live_owners(fleet_members(scenario)), scenario.get<VehicleSettings>().name,
                  options.expected_nodes},
                 loop),
        bus_(open_bus(url, loop, [this](const Message& message) { return takes(message); })) {
    if (!options.stands_alone) subscribe_to_presences();
  }
  Bus& bus() { return *bus_; }
  void answer_by(Presence& presence) { presence_ = &presence; }

 private:
  static constexpr std::size_t kMostWarnings = 8;

  void subscribe_to_presences() {
    bus_->subscribe(kPresenceChannel, kDeepQueue, [this](const Message& message) {
      presence_t presence{};
      const bool is_new =
          decode(message.bytes, presence) && senders_.heard(presence, message.sender);
      if (is_new && presence_ != nullptr) presence_->answer();
    });
  }
  bool takes(const Message& message) {
    if (senders_.takes(message)) return true;
    const std::optional<std::string> owner = senders_.owner_heard(message);
    if (!owner || warned_.size() >= kMostWarnings || !warned_.insert(message.sender).second) {
      return false;
    }
    say(Severity::warning,
        fmt::format(
            "{}: {} of {} is refused: {} sends it in this run. A program in that place must "
            "say so on {}",
            name_, message.channel, sender_name(message.sender), printable(*owner),
            kPresenceChannel));
    return false;
  }

  std::string name_;
  RunSenders senders_;
  std::unique_ptr<Bus> bus_;
  Presence* presence_ = nullptr;
  std::set<std::uint64_t> warned_;
};

enum class End { signal, clock_jumped };

/// Lets the loop go on until the node has ended in good order.
void wind_down(Node& node, RealTimeLoop& loop) {
  constexpr Duration kPoll = std::chrono::milliseconds{10};
  const Instant deadline = loop.now() + kWindDownLimit;
  while (!node.wind_down() && loop.now() < deadline) loop.run_until(loop.now() + kPoll);
}

End run_once(const NodeProgram& program, const Options& options, const Scenario& scenario) {
  RealTimeLoop loop(options.start_utime_us.value_or(RealTimeLoop::wall_utime_us()), options.speed,
                    options.start_boot_ns);
  const std::string url = checked_lcm_url(options.lcm_url);
  RunNetwork network(program, options, scenario, url, loop);
  Bus& bus = network.bus();
  std::optional<RunNetwork> other;
  if (!options.control_lcm_url.empty() && checked_lcm_url(options.control_lcm_url) != url) {
    other.emplace(program, options, scenario, options.control_lcm_url, loop);
  }
  Bus& control_bus = other ? other->bus() : bus;

  ServiceManager manager(loop);
  std::optional<ClockFollower> clock;
  if (!options.start_utime_us && !program.owns_clock && !options.stands_alone) {
    clock.emplace(loop, bus);
    say(Severity::info, fmt::format("{}: waiting for SIM/CLOCK on {}", program.name, url));
    manager.status("waiting for SIM/CLOCK on " + url);
    if (!clock->wait(program.name)) return End::signal;
  }

  std::vector<Bus*> networks{&bus};
  if (other) networks.push_back(&other->bus());
  std::optional<Presence> presence;
  std::optional<LoopReport> report;
  if (!options.stands_alone) {
    presence.emplace(loop, networks, program.name, scenario.get<VehicleSettings>().name);
    presence->answer();  // before all else that this program says
    network.answer_by(*presence);
    if (other) other->answer_by(*presence);
    report.emplace(loop, networks, program.name);
  }
  const auto node = program.make({scenario, loop, bus, control_bus});
  say(Severity::info,
      fmt::format("{}: running, t = {:.3f} s, on {}", program.name, to_seconds(loop.now()), url));
  manager.ready("running on " + url);
  loop.run();
  manager.stopping();
  wind_down(*node, loop);
  if (clock && clock->jumped()) {
    say(Severity::warning, fmt::format("{}: SIM/CLOCK jumped: starting over", program.name));
    return End::clock_jumped;
  }
  node->finish();
  if (report) report->publish_now();
  if (loop.slips() > 0) {
    say(Severity::warning,
        fmt::format("{}: {} deadline slips, worst lateness {:.1f} ms", program.name, loop.slips(),
                    to_milliseconds(loop.lateness_max())));
  }
  return End::signal;
}

/// Refuses options that make no sense in lockstep, which has one network and simulated time.
void check_lockstep(const Options& options) {
  for (const auto& [given, option] :
       {std::pair{!options.control_lcm_url.empty(), "--control-lcm-url"},
        std::pair{options.start_utime_us.has_value(), "--start-utime"},
        std::pair{options.speed != 1.0, "--speed"}, std::pair{options.stands_alone, "--rule"}}) {
    if (given) throw UsageError(fmt::format("{} does not go with --lockstep", option));
  }
}

void run_in_lockstep(const NodeProgram& program, const Options& options, const Scenario& scenario) {
  RealTimeLoop io(RealTimeLoop::wall_utime_us());
  UdpmBus wire(checked_lcm_url(options.lcm_url), io);
  LockstepMember member({.session = *options.lockstep_session,
                         .instance = RealTimeLoop::number_of_this_start(),
                         .name = program.lockstep_name,
                         .start = kStart - from_seconds(scenario.get<RunSettings>().lead_s)},
                        io, wire);
  const auto node = program.make({scenario, member.loop(), member.bus(), member.bus()});
  member.join(*node);
  io.run();
  if (!member.error().empty()) throw std::runtime_error(member.error());
}

Scenario scenario_of(const Options& options) {
  if (!options.stands_alone && options.scenario_file.empty()) {
    throw UsageError("scenario is required");
  }
  if (options.stands_alone && !options.control_lcm_url.empty()) {
    throw UsageError("--control-lcm-url has no effect with --rule: rules name their networks");
  }
  return options.scenario_file.empty() ? parse_scenario("", "defaults", options.overrides)
                                       : load_scenario(options.scenario_file, options.overrides);
}

}  // namespace

int node_main(int argc, char** argv, const NodeProgram& program) {
  Options options;
  CLI::App app(program.description, program.name);
  add_about(app);
  app.add_option("scenario", options.scenario_file, "scenario file (TOML)");
  app.add_option("--set", options.overrides, "override a scenario key: KEY=VALUE (repeatable)")
      ->allow_extra_args(false);
  app.add_option("--lcm-url", options.lcm_url, "LCM network")
      ->envname("LCM_DEFAULT_URL")
      ->capture_default_str();
  if (program.joins_two_networks) {
    app.add_option("--control-lcm-url", options.control_lcm_url,
                   "LCM network of the controller's side [the same]; on one host use another port");
  }
  app.add_option("--start-utime", options.start_utime_us,
                 program.owns_clock
                     ? "wall-clock time of t = 0, microseconds since 1970 [now]"
                     : "wall-clock time of t = 0, microseconds since 1970 [follow SIM/CLOCK]")
      ->check(CLI::Range(std::int64_t{0}, std::int64_t{4'000'000'000'000'000}));
  app.add_option("--start-boot", options.start_boot_ns,
                 "the same time on this host's CLOCK_BOOTTIME, nanoseconds; takes precedence, "
                 "because it never steps (`tether live` starts its nodes so)")
      ->needs(app.get_option("--start-utime"));
  app.add_option("--expect", options.expected_nodes,
                 "nodes that take part in the run (sim, netem, controller, can, autonomy, "
                 "localiser): from the first message on, their channels are accepted only from "
                 "their programs (`tether live` starts its nodes so)")
      ->check(CLI::IsMember({"sim", "netem", "controller", "can", "autonomy", "localiser"}))
      ->delimiter(',')
      ->allow_extra_args(false);
  app.add_option("--speed", options.speed,
                 "run seconds per wall second; below 1 is slow motion, the same for all nodes")
      ->check(number_between(0.01, 1.0))
      ->capture_default_str();
  if (!program.lockstep_name.empty()) {
    app.add_option("--lockstep", options.lockstep_session,
                   "take part in a run in simulated time: its session, 0: any (`tether run "
                   "--processes` starts its nodes so)")
        ->check(CLI::Range(std::int64_t{0}, INT64_MAX));
  }
  app.add_flag("--lock-memory", options.locks_memory,
               "keep all memory from being paged out (needs LimitMEMLOCK=infinity)");
  program.own.add(app);
  add_examples(app, program.examples);
  return run_cli(app, argc, argv, [&] {
    if (options.locks_memory) lock_memory();
    options.stands_alone = program.own.stand_alone();
    const Scenario scenario = scenario_of(options);
    program.own.check(scenario, options.lcm_url, options.overrides);
    if (options.lockstep_session) {
      check_lockstep(options);
      run_in_lockstep(program, options, scenario);
      return kExitOk;
    }
    while (run_once(program, options, scenario) == End::clock_jumped) {
    }
    return kExitOk;
  });
}

}  // namespace tether
