#include "tools/nodes/live_session.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <set>
#include <stdexcept>
#include <system_error>
#include <tether/counters_t.hpp>

#include "can_bridge/drivetrain/can_settings.hpp"
#include "common/base/share.hpp"
#include "common/base/text.hpp"
#include "common/fleet/fleet.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/lcm/udpm_bus.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/message_io.hpp"
#include "common/node/sole_sender.hpp"
#include "common/program/cli.hpp"
#include "common/program/loop_report.hpp"
#include "common/program/node_main.hpp"
#include "common/program/presence.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/onboard_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "tools/base/process.hpp"
#include "tools/runs/run_summary.hpp"

namespace tether {
namespace {

/// Maximum number of reported findings; more would add nothing.
constexpr std::size_t kMaxFindings = 20;
/// More senders than a run has.
constexpr std::size_t kMostNamed = 10'000;

}  // namespace

std::string describe(const presence_t& presence) {
  return fmt::format("{} of {}, process {} on host {}", printable(presence.program),
                     printable(presence.vehicle), presence.pid, printable(presence.host));
}

void RunWatch::started(Instant now, const std::string& program, std::int64_t pid) {
  ended(program);
  const Duration starting = from_seconds(to_seconds(kPatience - kSilence) * rate_);
  own_[program] = {.pid = pid, .heard = std::max(now, kStart) + starting};
}

void RunWatch::ended(const std::string& program) {
  const auto own = own_.find(program);
  if (own == own_.end()) return;
  former_.push_back({program, own->second.pid, own->second.port});  // its last messages may come
  own_.erase(own);
}

void RunWatch::given_up(Instant now, const std::string& program) {
  find(now, program + " hangs: ending it");
  ended(program);
}

void RunWatch::sent(Instant now, const std::string& channel, std::uint64_t sender) {
  if (sender == 0 || named_.contains(sender) || unnamed_.size() >= kMaxFindings) return;
  unnamed_.try_emplace(sender, Unnamed{channel, now});
}

void RunWatch::sent_by_controller(Instant now, const std::string& channel, std::uint64_t sender) {
  if (sender == 0) return;
  const std::uint64_t first = controllers_.try_emplace(channel, sender).first->second;
  if (first == sender) return;
  find(now, fmt::format("{} and {} sent on {}, which belongs to one external controller",
                        sender_name(first), sender_name(sender), channel));
}

void RunWatch::judge_senders(Instant now, Instant since) {
  for (auto it = unnamed_.begin(); it != unnamed_.end();) {
    const auto& [sender, unnamed] = *it;
    if (unnamed.since > since) {
      ++it;
      continue;
    }
    find(now,
         fmt::format("an unknown program sent on {}: {}", unnamed.channel, sender_name(sender)));
    named_.insert(sender);
    it = unnamed_.erase(it);
  }
}

void RunWatch::late(const std::string& program, std::int64_t us_s) {
  if (!late_.contains(program) && late_.size() >= kMaxFindings) return;
  Late& late = late_[program];
  if (us_s < late.newest_us_s) late.before_us_s += late.newest_us_s;
  late.newest_us_s = us_s;
}

std::string RunWatch::lateness(Duration run) const {
  double sum_ms = 0.0, worst_ms = 0.0;
  std::string worst;
  for (const auto& [program, late] : late_) {
    const auto us_s = static_cast<double>(late.before_us_s) + static_cast<double>(late.newest_us_s);
    const double mean_ms = us_s * 1e-3 / std::max(to_seconds(run), 1e-3);
    sum_ms += mean_ms;
    if (mean_ms <= worst_ms) continue;
    worst_ms = mean_ms;
    worst = program;
  }
  if (sum_ms <= to_milliseconds(kMostLateness)) return "";
  return fmt::format(
      "the machine was too slow: late programs made messages {:.1f} ms older on "
      "average, {} alone {:.1f} ms; at most {} ms are allowed. Use --speed below 1 or "
      "end other work",
      sum_ms, printable(worst), worst_ms, to_milliseconds(kMostLateness));
}

void RunWatch::end(Instant now) { judge_senders(now, now); }

void RunWatch::name(std::uint64_t sender) {
  if (named_.size() < kMostNamed) named_.insert(sender);
  unnamed_.erase(sender);
}

void RunWatch::heard(Instant now, const presence_t& presence, std::uint64_t sender,
                     bool from_this_host) {
  if (presence.run != run_) {
    name(sender);
    return heard_of_other_run(now, presence);
  }
  const bool here = presence.host == host_ && from_this_host;
  const auto port = static_cast<std::uint16_t>(sender);
  const auto own = own_.find(presence.program);
  if (here && own != own_.end() && own->second.pid == presence.pid) {
    if (own->second.port == 0) own->second.port = port;
    if (own->second.port != port) {
      return find(now, fmt::format("{} says that it is {}, which sends from another port",
                                   sender_name(sender), describe(presence)));
    }
    own->second.heard = now;
    return name(sender);
  }
  const bool ended = std::any_of(former_.begin(), former_.end(), [&](const Former& f) {
    return f.program == presence.program && f.pid == presence.pid && f.port == port;
  });
  if (here && ended) return name(sender);
  if (own == own_.end()) return;  // its messages on the run's channels make it an unknown sender
  name(sender);
  has_unknown_senders_ = true;
  find(now, "a second " + describe(presence));
}

void RunWatch::heard_of_other_run(Instant now, const presence_t& presence) {
  has_unknown_senders_ = true;
  const auto known = std::find(other_runs_.begin(), other_runs_.end(), presence.run);
  if (known != other_runs_.end() || other_runs_.size() >= kMaxFindings) return;
  other_runs_.push_back(presence.run);
  find(now, "another run is on this network: " + describe(presence));
}

void RunWatch::several_senders(Instant now, const std::string& line) {
  if (!has_unknown_senders_) find(now, line);
}

void RunWatch::update(Instant now) {
  const bool was_suspended =
      updated_ && now - *updated_ > from_seconds(to_seconds(kSilence) * rate_);
  updated_ = now;
  if (was_suspended) {
    for (auto& [sender, unnamed] : unnamed_) unnamed.since = now;
  }
  judge_senders(now, now - from_seconds(to_seconds(kSilence) * rate_));
  for (auto& [program, own] : own_) {
    if (was_suspended) own.heard = std::max(own.heard, now);
    const bool hangs = silence(own, now) >= kSilence;
    if (hangs && !own.reported) find(now, program + " does not answer: stopped, hung or cut off");
    own.reported = hangs;
  }
}

Duration RunWatch::silence(const Own& own, Instant now) const {
  return from_seconds(to_seconds(now - own.heard) / rate_);
}

std::vector<std::pair<std::string, Duration>> RunWatch::hung(Instant now) const {
  std::vector<std::pair<std::string, Duration>> hung;
  for (const auto& [program, own] : own_) {
    if (own.reported) hung.emplace_back(program, silence(own, now));
  }
  return hung;
}

bool RunWatch::hangs(const std::string& program, Instant now, Duration for_so_long) const {
  const auto own = own_.find(program);
  return own != own_.end() && silence(own->second, now) >= for_so_long;
}

void RunWatch::find(Instant now, const std::string& what) {
  if (findings_.size() >= kMaxFindings ||
      std::find(known_.begin(), known_.end(), what) != known_.end()) {
    return;
  }
  known_.push_back(what);
  findings_.push_back(fmt::format("t = {:.1f} s: {}", to_seconds(now), what));
}

namespace {

constexpr char kName[] = "tether live";
/// Wait before any node is started, in which every program on the network is heard twice.
constexpr Duration kListening = 2 * kPresencePeriod;
/// Time for that, and for all nodes to start, before the run's lead and so before t = 0.
constexpr std::int64_t kLeadTime_us = 2'000'000;
constexpr Duration kWatchPeriod = std::chrono::milliseconds{250};
/// Time in which a node has to end after SIGTERM.
constexpr Duration kEndingPatience = std::chrono::seconds{1};
constexpr Duration kStatusPeriod = std::chrono::milliseconds{500};
constexpr Duration kRestartDelay = std::chrono::milliseconds{300};
constexpr Duration kShutDownPatience = kWindDownLimit + std::chrono::seconds{1};
/// Time for the nodes' last messages to arrive.
constexpr Duration kLinger = std::chrono::milliseconds{200};
constexpr int kMaxRestarts = 20;

/// In the order in which they end: the bridge has to stop its drives first, and the drives need the
/// simulator's wheels for that.
std::vector<std::string> programs(const Scenario& scenario) {
  const std::vector<Scenario> members = fleet_members(scenario);
  std::vector<std::string> names;
  const auto& controller = scenario.get<ControllerSettings>();
  if (controller.ros2) {
    names.emplace_back("tether-ros2");
  } else if (!controller.is_external()) {
    names.emplace_back("tether-controller");
  }
  names.emplace_back("tether-netem");
  if (!members_with(has_autonomy, members).empty()) names.emplace_back("tether-autonomy");
  if (scenario.get<VehicleSettings>().drivetrain == VehicleSettings::Drivetrain::can) {
    names.emplace_back("tether-can-bridge");
    if (scenario.get<CanSettings>().emulate_drives) names.emplace_back("tether-can-drive");
  }
  if (!members_with(has_localiser, members).empty()) names.emplace_back("tether-localiser");
  names.emplace_back("tether-sim");
  return names;
}

/// The nodes of these programs, as options name them: --expect=sim,netem,controller.
std::string expected_nodes(const Scenario& scenario) {
  std::set<std::string> nodes;
  for (const std::string& program : programs(scenario)) nodes.insert(node_of_program(program));
  return fmt::format("--expect={}", fmt::join(nodes, ","));
}

/// All on which one program alone sends, in a run of one vehicle.
std::vector<std::string> channels_of_one_sender(const std::string& vehicle) {
  const ChannelNames c(vehicle);
  return {c.vehicle_pose,
          c.vehicle_odometry,
          c.vehicle_scan,
          c.vehicle_scan_part,
          c.vehicle_localisation,
          c.vehicle_autonomy,
          c.vehicle_drive,
          c.autonomy_counters,
          c.vehicle_command,
          c.vehicle_plan,
          c.vehicle_preload,
          c.control_pose,
          c.control_odometry,
          c.control_scan_part,
          c.control_localisation,
          c.control_autonomy,
          c.control_command,
          c.control_plan,
          c.control_preload,
          c.control_report,
          c.control_counters,
          c.can_state,
          c.can_wheels,
          c.can_odometry,
          c.can_plan,
          c.can_counters,
          c.drive_counters,
          c.wheel_states,
          c.wheel_targets,
          c.uplink_report,
          c.downlink_report,
          c.net_counters,
          c.net_settings,
          c.clock,
          c.truth,
          c.sim_counters,
          c.localiser_counters};
}

std::vector<std::string> channels_of_one_sender(const Scenario& scenario) {
  std::set<std::string> all;  // the clock is all vehicles'
  for (const Scenario& member : fleet_members(scenario)) {
    const auto own = channels_of_one_sender(member.get<VehicleSettings>().name);
    all.insert(own.begin(), own.end());
  }
  return {all.begin(), all.end()};
}

/// Channels of external controllers, which have no presence.
std::set<std::string> channels_of_external_controllers(const Scenario& scenario) {
  std::set<std::string> channels;
  for (const Scenario& member : fleet_members(scenario)) {
    const auto& controller = member.get<ControllerSettings>();
    if (!controller.is_external() || controller.ros2) continue;
    const ChannelNames c(member.get<VehicleSettings>().name);
    channels.insert({c.control_command, c.control_plan, c.control_preload, c.control_report,
                     c.control_counters});
  }
  return channels;
}

}  // namespace

LiveSession::LiveSession(const Options& options, const Scenario& scenario)
    : url_(options.lcm_url),
      scenario_(scenario),
      status_(options.show_status),
      dashboard_(fleet_members(scenario).front()),
      end_(kStart + from_seconds(scenario.get<RunSettings>().duration_s)),
      loop_(RealTimeLoop::wall_utime_us() + kLeadTime_us +
                to_utime(kStart + from_seconds(scenario.get<RunSettings>().lead_s / options.speed)),
            options.speed),
      network_(open_bus(options.lcm_url, loop_)),
      recorder_(open_bus(options.lcm_url, loop_)),
      vehicle_(scenario.get<VehicleSettings>().name),
      watch_(loop_.run_id(), host_name(), options.speed),
      senders_(loop_, bus_, channels_of_one_sender(scenario),
               [this](const std::string& line) { watch_.several_senders(loop_.now(), line); }),
      observer_(fleet_members(scenario), loop_, bus_),
      operator_(scenario, loop_, bus_),
      guest_(url_, [this](const std::string& line) { status_.say("controller: " + line); }) {
  if (!options.out.empty()) {
    folder_.emplace(options.out, scenario);
    folder_->record(loop_, *recorder_);
  }
  bus_.subscribe(kPresenceChannel, kDeepQueue, [this](const Message& message) {
    presence_t presence{};
    if (decode(message.bytes, presence)) return on_presence(presence, message.sender);
    ++undecodable_;
  });
  subscribe<counters_t>(bus_, kLoopChannel, kDeepQueue, undecodable_, [this](const counters_t& m) {
    const auto found = std::find(m.name.begin(), m.name.end(), kLatenessCounter);
    if (found == m.name.end()) return;
    watch_.late(m.node, m.value[static_cast<std::size_t>(found - m.name.begin())]);
  });
  const std::set<std::string> external = channels_of_external_controllers(scenario);
  for (const std::string& channel : channels_of_one_sender(scenario)) {
    const auto sent = external.contains(channel) ? &RunWatch::sent_by_controller : &RunWatch::sent;
    bus_.subscribe(channel, kDeepQueue, [this, sent](const Message& message) {
      (watch_.*sent)(loop_.now(), std::string(message.channel), message.sender);
    });
  }
  for (const std::string& name : programs(scenario)) add_child(options, name);
  if (options.view) add_view(options);
}

void LiveSession::add_view(const Options& options) {
  std::vector<std::string> command{(executable_folder() / "tether").string(), "view",
                                   "--lcm-url=" + options.lcm_url,
                                   "--scenario=" + options.scenario_file};
  for (const std::string& text : options.overrides) command.push_back("--set=" + text);
  command.insert(command.end(), options.view->begin(), options.view->end());
  view_ = std::make_unique<NodeProcess>(
      loop_, std::move(command), [this](const std::string& line) { status_.say(line); },
      [this](int code) {
        if (ending_) return;
        if (loop_.now() >= kStart) {
          return status_.say(fmt::format("t = {:.1f} s: tether view ended (exit code {})",
                                         to_seconds(loop_.now()), code));
        }
        failure_ = fmt::format("tether view did not start (exit code {})", code);
        loop_.stop();
      });
}

void LiveSession::add_child(const Options& options, const std::string& name) {
  const std::string program = (executable_folder() / name).string();
  if (access(program.c_str(), X_OK) != 0) {
    throw std::runtime_error(fmt::format("cannot start {}: {}; tether expects its nodes beside it",
                                         program, std::generic_category().message(errno)));
  }
  std::vector<std::string> command{program,
                                   options.scenario_file,
                                   "--lcm-url=" + options.lcm_url,
                                   fmt::format("--start-utime={}", loop_.run_id()),
                                   fmt::format("--start-boot={}", loop_.start_boot_ns()),
                                   fmt::format("--speed={}", options.speed),
                                   expected_nodes(scenario_)};
  for (const std::string& text : options.overrides) command.push_back("--set=" + text);

  children_.push_back(std::make_unique<Child>());
  Child& child = *children_.back();
  child.name = name;
  child.process = std::make_unique<NodeProcess>(
      loop_, std::move(command),
      [this, &child](const std::string& line) {
        if (line.starts_with(child.name + ": running, ")) child.has_run = true;
        status_.say(line);
      },
      [this, &child](int code) { on_child_exit(child, code); });
}

void LiveSession::on_presence(const presence_t& presence, std::uint64_t sender) {
  if (!starting_) {
    return watch_.heard(loop_.now(), presence, sender, is_of_this_host(sender));
  }
  if (company_.empty() || presence.program == kName) company_ = describe(presence);
}

bool LiveSession::is_of_this_host(std::uint64_t sender) {
  if (sender == 0) return true;
  if (!own_addresses_) own_addresses_.emplace();
  own_addresses_->refresh();
  return own_addresses_->contains(in_addr{static_cast<in_addr_t>(sender >> 16)});
}

void LiveSession::expect_no_company() {
  loop_.run_until(loop_.now() + from_seconds(to_seconds(kListening) * loop_.rate()));
  starting_ = false;
  if (company_.empty()) {
    presence_.emplace(loop_, std::vector<Bus*>{&bus_}, kName, vehicle_);
    return;
  }
  throw std::runtime_error(
      fmt::format("another run is on {}: {}. End it, or give this one a network of its own: "
                  "--lcm-url '{}'",
                  url_, company_, with_next_port(url_)));
}

void LiveSession::start(Child& child) {
  child.process->start();
  watch_.started(loop_.now(), child.name, child.process->pid());
}

void LiveSession::start_guest() {
  guest_.begin(scenario_, 0, loop_, [this](const std::string& how) {
    if (ending_) return;
    failure_ = fmt::format("t = {:.1f} s: controller.command {}", to_seconds(loop_.now()), how);
    loop_.stop();
  });
}

void LiveSession::watch_run() {
  const Instant now = loop_.now();
  watch_.update(now);
  for (auto& child : children_) {
    const bool has_to_end = ending_ && child.get() == ending_child_;
    if (!watch_.hangs(child->name, now, has_to_end ? kEndingPatience : RunWatch::kPatience)) {
      continue;
    }
    watch_.given_up(now, child->name);
    child->process->send_signal(SIGKILL);
  }
  for (; findings_said_ < watch_.findings().size(); ++findings_said_) {
    status_.say(watch_.findings()[findings_said_]);
  }
}

void LiveSession::run() {
  expect_no_company();
  if (view_) view_->start();
  for (auto& child : children_) start(*child);
  start_guest();
  loop_.every(loop_.now(), from_seconds(to_seconds(kWatchPeriod) * loop_.rate()),
              Priority::observer, [this](Instant) { watch_run(); });
  loop_.every(loop_.now(), kStatusPeriod, Priority::observer, [this](Instant) { show_status(); });
  loop_.run_until(end_ + kLinger);
  end_ = std::min(end_, loop_.now());
  shut_down();
  if (!failure_.empty()) throw std::runtime_error(failure_);
  if (observer_.first().truth().utime > 0) return;
  throw std::runtime_error(
      interrupted() ? "no result: ended before t = 0"
                    : fmt::format("no result: no SIM/TRUTH from tether-sim was heard on {}; does a "
                                  "firewall stop multicast?",
                                  url_));
}

/// External controllers have no presence; they are judged by their messages.
std::vector<std::string> LiveSession::mute_controllers() const {
  std::vector<std::string> all;
  const std::vector<Scenario> members = fleet_members(scenario_);
  for (std::size_t i = 0; i < members.size(); ++i) {
    const RunObserver& vehicle = *observer_.vehicles()[i];
    const bool has_to_answer = members[i].get<ControllerSettings>().is_external() &&
                               !members[i].get<AutonomySettings>().enabled;
    const bool was_heard = vehicle.downlink().offered > 0 || vehicle.commands_received() > 0;
    if (!has_to_answer || was_heard || vehicle.poses_received() == 0) continue;
    all.push_back(fmt::format("the controller of {} never sent a command, and {} poses reached it",
                              members[i].get<VehicleSettings>().name, vehicle.poses_received()));
  }
  return all;
}

std::vector<std::string> LiveSession::findings() const {
  std::vector<std::string> all = watch_.findings();
  for (std::string& mute : mute_controllers()) all.push_back(std::move(mute));
  std::vector<std::string> more{observer_.refused_commands(), observer_.jumps(),
                                watch_.lateness(end_ - kStart)};
  if (restarts_ == 0) {  // a node that was started again counts from 0
    more.push_back(observer_.restarts());
    more.push_back(observer_.surplus());
  }
  for (std::string& finding : more) {
    if (!finding.empty()) all.push_back(std::move(finding));
  }
  const auto add_lost = [&all](const Bus& bus, const std::string& who) {
    CounterList network;
    bus.list_counters(network);
    for (const auto& [name, count] : network) {
      if (name != "datagrams_dropped" || count == 0) continue;
      all.push_back(
          fmt::format("{} lacks {} datagrams: the kernel's buffer was full (`tether doctor` says "
                      "how to enlarge it)",
                      who, count));
    }
  };
  add_lost(*network_, "this verdict");
  if (folder_) add_lost(*recorder_, "the recording");
  return all;
}

void LiveSession::on_child_exit(Child& child, int code) {
  watch_.ended(child.name);
  if (ending_) {
    if (&child == ending_child_) loop_.stop();
    return;
  }
  // An error that ends a node at its very start would end it again, and the node has said what it
  // is. A node that a signal ended may live when it is started again.
  const bool refused = code == kExitUsage || code == 127 || (code == kExitFailed && !child.has_run);
  if (refused || restarts_ >= kMaxRestarts) {
    failure_ = refused ? fmt::format("{} did not start (exit code {})", child.name, code)
                       : fmt::format("{} ended again (exit code {}): giving up after {} restarts",
                                     child.name, code, restarts_);
    loop_.stop();
    return;
  }
  ++restarts_;
  status_.say(fmt::format(
      "t = {:.1f} s: {} ended with {}; starting it again", to_seconds(loop_.now()), child.name,
      code > 128 ? fmt::format("signal {}", code - 128) : fmt::format("exit code {}", code)));
  loop_.at(loop_.now() + kRestartDelay, Priority::node, [this, &child](Instant) {
    if (!ending_) start(child);
  });
}

void LiveSession::shut_down() {
  ending_ = true;
  guest_.end(false);
  watch_.end(loop_.now());
  for (auto& child : children_) {
    ending_child_ = child.get();
    child->process->send_signal(SIGTERM);
    if (child->process->running()) loop_.run_until(loop_.now() + kShutDownPatience);
  }
  for (auto& child : children_) child->process->send_signal(SIGKILL);
  if (view_) view_->send_signal(SIGTERM);
  loop_.run_until(loop_.now() + kLinger);
  status_.clear();
}

std::vector<std::string> LiveSession::silent() const {
  std::vector<std::string> all;
  for (const auto& [program, silence] : watch_.hung(loop_.now())) {
    all.push_back(fmt::format("{} SILENT for {:.1f} s", program, to_seconds(silence)));
  }
  return all;
}

std::string LiveSession::drives() const {
  if (!observer_.first().drivetrain()) return "";
  const drivetrain_state_t& state = observer_.first().drivetrain()->state();
  return state.seq > 0 ? state.state_name : "silent";
}

std::vector<Position> LiveSession::others() const {
  std::vector<Position> places;
  for (const RunObserver* vehicle : observer_.vehicles()) {
    const ground_truth_t& truth = vehicle->truth();
    if (vehicle != &observer_.first()) places.push_back({truth.x_m, truth.y_m});
  }
  return places;
}

void LiveSession::show_status() {
  const RunObserver& first = observer_.first();
  const double t_s = to_seconds(loop_.now());
  uplink_.add(t_s, first.uplink(), first.poses_received());
  downlink_.add(t_s, first.downlink(), first.commands_received());
  const Dashboard::Moment moment{.t_s = t_s,
                                 .uplink = uplink_.seen(),
                                 .downlink = downlink_.seen(),
                                 .fleet = fleet_now(observer_, loop_.now()),
                                 .others = others(),
                                 .drives = drives(),
                                 .findings = watch_.findings(),
                                 .silent = silent()};
  if (loop_.now() < kStart) {
    status_.show({moment.drives.empty() ? "starting" : "starting   drives " + moment.drives});
  } else if (status_.has_room(Dashboard::kColumns, Dashboard::kRows)) {
    status_.show(dashboard_.lines(first, moment));
  } else {
    status_.show({dashboard_.line(first, moment)});
  }
}

}  // namespace tether
