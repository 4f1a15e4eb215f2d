#include "tools/gym/episode.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <tether/pose_t.hpp>
#include <utility>

#include "common/base/errors.hpp"
#include "common/fleet/fleet.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/message_io.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/frames.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "controller/laws/law.hpp"
#include "controller/laws/tracking_law.hpp"

namespace tether {
namespace {

constexpr double kLongestLookAhead_s = 60.0;

struct KindRow {
  ActionKind kind;
  const char* name;
  bool decides;  ///< in the place of the law
  bool (*suits)(const LawKind&);
};
constexpr KindRow kKinds[] = {
    {ActionKind::twist, "twist", true, [](const LawKind& l) { return !l.sends_plans; }},
    {ActionKind::plan, "plan", true, [](const LawKind& l) { return l.sends_plans; }},
    {ActionKind::tau, "tau", false, [](const LawKind& l) { return l.looks_ahead; }},
    {ActionKind::send, "send", false, [](const LawKind&) { return true; }},
};

const KindRow& row_of(ActionKind kind) {
  return *std::find_if(std::begin(kKinds), std::end(kKinds),
                       [&](const KindRow& row) { return row.kind == kind; });
}

bool suits(const KindRow& row, const LawKind& law) {
  return row.suits(law) && !(row.decides && law.drives_on_request);
}

}  // namespace

ActionKind action_kind(const std::string& name) {
  std::string names;
  for (const KindRow& row : kKinds) {
    if (row.name == name) return row.kind;
    names += fmt::format("{}\"{}\"", names.empty() ? "" : ", ", row.name);
  }
  throw UsageError(fmt::format("action: there is no \"{}\"; allowed: {}", name, names));
}

std::vector<NumberSpace> action_space(const Scenario& scenario, ActionKind kind) {
  const auto& controller = scenario.get<ControllerSettings>();
  const NumberSpace send{"send", 0.0, 1.0};
  if (kind == ActionKind::send) return {send};
  if (kind == ActionKind::tau) return {{"tau_s", 0.0, kLongestLookAhead_s}, send};
  std::vector<NumberSpace> space;
  const std::size_t twists = kind == ActionKind::plan ? controller.plan_steps() : 1;
  for (std::size_t i = 0; i < twists; ++i) {
    space.push_back({"v_mps", -controller.v.limit, controller.v.limit});
    space.push_back({"omega_radps", -controller.omega.limit, controller.omega.limit});
  }
  return space;
}

void check_actions(const Scenario& scenario, ActionKind kind) {
  const auto& controller = scenario.get<ControllerSettings>();
  if (!scenario.get<FleetSettings>().is_one()) {
    throw UsageError("fleet.count: an environment has one vehicle; allowed: 1");
  }
  const KindRow& row = row_of(kind);
  if (!suits(row, kind_of(controller))) {
    std::string laws;
    for (const LawKind& law : law_kinds()) {
      if (suits(row, law)) laws += (laws.empty() ? "" : ", ") + law.name;
    }
    throw UsageError(
        fmt::format("controller.law: there are no actions \"{}\" with \"{}\"; allowed: {}",
                    row.name, controller.law, laws));
  }
  if (!row.decides) return;
  if (controller.estimator != ControllerSettings::Estimator::none) {
    throw UsageError(
        fmt::format("controller.estimator: actions \"{}\" take the place of the law and its "
                    "filter; allowed: none",
                    row.name));
  }
  if (controller.preload) {
    throw UsageError(
        "controller.preload: no action makes the plan before departure; allowed: false");
  }
}

void check_action(std::span<const double> action, std::span<const NumberSpace> space) {
  for (std::size_t i = 0; i < action.size(); ++i) {
    const NumberSpace& allowed = space[i];
    if (action[i] >= allowed.low && action[i] <= allowed.high) continue;  // never of NaN
    throw UsageError(fmt::format("action[{}] ({}) is {}; allowed: a number in [{}, {}]", i,
                                 allowed.name, action[i], allowed.low, allowed.high));
  }
}

GivenLaw::GivenLaw(LawContext context, bool plans)
    : context_(std::move(context)),
      plans_(plans),
      sensor_latency_(
          from_seconds(context_.settings.get<ControllerSettings>().sensor_latency_ms * 1e-3)),
      delay_(DelayEstimate::kFew) {}

void GivenLaw::give(std::span<const double> twists) {
  given_.clear();
  for (std::size_t i = 0; i + 1 < twists.size(); i += 2) {
    given_.push_back({twists[i], twists[i + 1]});
  }
}

void GivenLaw::on_pose(const SeenPose& seen) {
  delay_.add(seen.arrival - seen.stamp - sensor_latency_);
  if (seen.plan_id && *seen.plan_id < static_cast<std::int64_t>(decided_.size())) {
    acknowledged_ = decided_[static_cast<std::size_t>(*seen.plan_id)];
  }
}

LawOutput GivenLaw::decide(Instant now, const SeenPose* newest) {
  errors_ = errors_to(
      newest == nullptr ? context_.settings.get<VehicleSettings>().start_pose() : newest->pose,
      context_.path->at(to_seconds(now)));
  if (!plans_) return given_.front();
  return plan(now, std::move(given_));
}

LawOutput GivenLaw::stop(Instant now) {
  if (!plans_) return Twist{};
  return plan(now, {Twist{}});
}

LawOutput GivenLaw::plan(Instant now, std::vector<Twist> twists) {
  Plan plan;
  plan.name.id = static_cast<std::int64_t>(decided_.size());
  decided_.push_back(now);
  plan.start =
      std::chrono::ceil<std::chrono::microseconds>(std::max(now + delay_.longest(), kStart));
  plan.step = context_.settings.get<ControllerSettings>().plan_step();
  plan.twists = std::move(twists);
  return plan;
}

void GivenLaw::list_counters(CounterList& out) const {
  if (plans_) out.emplace_back("plan.made", static_cast<std::int64_t>(decided_.size()));
}

namespace {

constexpr double kAny = std::numeric_limits<double>::infinity();

const Scenario& checked(const Scenario& scenario, ActionKind kind) {
  check_actions(scenario, kind);
  return scenario;
}

std::unique_ptr<Law> law_of(const Scenario& scenario, const LawContext& context, ActionKind kind,
                            GivenLaw*& given) {
  if (kind == ActionKind::tau || kind == ActionKind::send) return make_law(scenario);
  auto law = std::make_unique<GivenLaw>(context, kind == ActionKind::plan);
  given = law.get();
  return law;
}

}  // namespace

std::vector<NumberSpace> observation_space(const EpisodeSettings& settings) {
  std::vector<NumberSpace> space{{"ahead_m", -kAny, kAny},
                                 {"left_m", -kAny, kAny},
                                 {"heading_rad", -std::numbers::pi, std::numbers::pi}};
  for (const char* name : {"path_v_mps", "path_omega_radps", "sent_v_mps", "sent_omega_radps",
                           "sent_age_s", "pose_age_s", "pose_silence_s"}) {
    space.push_back({name, -kAny, kAny});
  }
  space.push_back({"pose_reception", 0.0, 1.0});
  if (settings.action == ActionKind::plan) space.push_back({"acknowledged_age_s", -kAny, kAny});
  for (const double tau_s : settings.preview_s) {
    if (!(tau_s >= 0.0 && std::isfinite(tau_s))) {
      throw UsageError(fmt::format("preview_s: {} is not allowed; finite numbers >= 0 are", tau_s));
    }
    space.push_back({fmt::format("ahead_m@{}", tau_s), -kAny, kAny});
    space.push_back({fmt::format("left_m@{}", tau_s), -kAny, kAny});
  }
  return space;
}

Episode::Episode(const Scenario& scenario, const EpisodeSettings& settings, const std::string& log)
    : settings_(settings),
      context_(law_context(checked(scenario, settings.action), false)),
      loop_(scenario, law_of(scenario, context_, settings.action, given_)),
      end_(kStart + from_seconds(scenario.get<RunSettings>().duration_s)) {
  loop_.controller().ask_before_deciding([this] {
    due_ = true;
    loop_.loop().stop();
  });
  subscribe<pose_t>(loop_.bus(), ChannelNames(scenario.get<VehicleSettings>().name).control_pose,
                    kDeepQueue, undecodable_, [this](const pose_t& m) {
                      if (m.seq <= newest_seq_) return;  // late
                      newest_seq_ = m.seq;
                      reception_.add(m.seq);
                    });
  if (!log.empty()) log_ = std::make_unique<EventLogWriter>(log, loop_.loop(), loop_.bus());
  go_on();
}

void Episode::step(std::span<const double> action) {
  if (due_) {
    if (given_ != nullptr) {
      given_->give(action);
    } else if (settings_.action == ActionKind::tau) {
      loop_.controller().law().set_look_ahead(action[0]);
    }
    loop_.controller().decide_by_law(given_ != nullptr || action.back() >= 0.5);
    go_on();
  }
  reward_ = -unrewarded();
  rewarded_ -= reward_;
}

void Episode::go_on() {
  due_ = false;
  loop_.run_until(end_);
  if (due_) return;
  loop_.finish();
  if (log_) log_->close();
  over_ = true;
}

SeenPose Episode::pose() {
  if (const SeenPose* newest = loop_.controller().newest()) return *newest;
  SeenPose start;
  start.pose = context_.settings.get<VehicleSettings>().start_pose();
  start.stamp = start.arrival = kStart;
  start.seq = -1;
  return start;
}

void Episode::observe(std::span<double> out) {
  const SeenPose seen = this->pose();
  const Instant now = loop_.loop().now();
  const auto since = [now](Instant then) { return to_seconds(now - then); };
  const double now_s = to_seconds(now);
  std::size_t i = 0;
  const auto put = [&](double number) { out[i++] = number; };
  const auto seen_here = [&](const PathPoint& p) {
    const Pose2 there = relative_to(seen.pose, {p.x_m, p.y_m, p.yaw_rad});
    put(there.x_m);
    put(there.y_m);
    return there;
  };

  const PathPoint here = context_.path->at(now_s);
  put(seen_here(here).yaw_rad);
  put(here.v_mps);
  put(here.omega_radps);
  const auto& sent = loop_.controller().last_sent();
  const Twist twist = sent ? sent->twist : Twist{};
  put(twist.v_mps);
  put(twist.omega_radps);
  put(since(sent ? sent->when : kStart));
  put(since(seen.stamp));
  put(since(seen.arrival));
  put(reception_.ratio());
  if (settings_.action == ActionKind::plan) put(since(given_->acknowledged().value_or(kStart)));
  for (const double tau_s : settings_.preview_s) {
    seen_here(context_.path->at(now_s + tau_s));
  }
  assert(i == out.size());
}

}  // namespace tether
