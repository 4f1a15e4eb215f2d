#include "common/vehicle/actuator.hpp"

#include <algorithm>
#include <iterator>
#include <numeric>
#include <utility>

namespace tether {
namespace {

/// Judges a plan by its contents alone.
PlanFate judge_contents(const Plan& plan) {
  const bool named = plan.name.session >= 0 && plan.name.id >= 0;
  const bool based = plan.based_on >= 0 ? plan.based_on_last >= plan.based_on
                                        : plan.based_on >= Plan::kBasedOnAny &&
                                              plan.based_on_last == plan.based_on;
  if (!named || !based || plan.twists.empty()) return PlanFate::unusable;
  if (plan.step <= Duration{0}) return PlanFate::bad_step;
  const auto count = static_cast<std::int64_t>(plan.twists.size());
  if (plan.twists.size() > PlanBuffer::kMaxTwists || plan.step > PlanBuffer::kMaxHorizon / count) {
    return PlanFate::too_long;
  }
  const bool usable = std::all_of(plan.twists.begin(), plan.twists.end(),
                                  [](const Twist& twist) { return is_usable(twist); });
  return usable ? PlanFate::accepted : PlanFate::unusable;
}

/// Whether `plan` may take over from `last`, a plan of its own session, at `t`.
bool is_base_of(const Plan& plan, const Plan& last, Instant t) {
  const std::int64_t id = last.name.id;
  if (id < plan.based_on || id > plan.based_on_last) return false;
  return plan.based_on == plan.based_on_last || (last.settled <= t && t < last.end());
}

}  // namespace

PlanBuffer::PlanBuffer(const StopLimits& limits, const StreamGuard::Config& guard)
    : limits_(limits),
      guards_{StreamGuard(guard), StreamGuard(guard)},
      max_ahead_(guard.max_ahead) {}

PlanFate PlanBuffer::offer(Instant now, PlanSource source, Plan plan) {
  const PlanFate fate = judge(now, source, plan);
  ++counts_[static_cast<std::size_t>(fate)];
  if (fate != PlanFate::accepted) return fate;
  if (max_age_ && source == PlanSource::network && judge_pose(now, plan) == PlanFate::accepted) {
    newest_pose_ = *plan.pose;
    seen_ = std::min({newest_pose_, plan.stamp, now});
  }
  insert(now, std::move(plan));
  return fate;
}

PlanFate PlanBuffer::judge(Instant now, PlanSource source, const Plan& plan) {
  const PlanFate contents = judge_contents(plan);
  if (contents != PlanFate::accepted) return contents;
  // Before the guard: plans of other sessions must not make plans of this session look old.
  if (session_ != plan.name.session && !may_take_over(now, plan)) return PlanFate::other_session;
  if (!guard(source).accept(now, plan.stamp, plan.seq)) return PlanFate::out_of_order;
  if (session_ == plan.name.session) session_heard_ = now;
  const bool known = std::any_of(schedule_.begin(), schedule_.end(), [&plan](const Entry& entry) {
    return entry.plan.name == plan.name;
  });
  if (known) return PlanFate::repeated;
  if (plan.stamp < stopped_) return PlanFate::before_stop;
  if (max_age_ && source == PlanSource::network && !(any_stop_ && plan.is_stop())) {
    const PlanFate fate = judge_pose(now, plan);
    if (fate != PlanFate::accepted) return fate;
  }
  const Duration ahead = source == PlanSource::preload ? kMaxPreload : kMaxAhead;
  if (plan.start > now + ahead) return PlanFate::too_early;
  if (plan.end() <= now) return PlanFate::expired;
  if (!is_consistent(now, plan)) return PlanFate::inconsistent;
  const auto stay = std::count_if(schedule_.begin(), schedule_.end(), [&](const Entry& entry) {
    return entry.from > now && entry.from < plan.start;
  });
  return stay < static_cast<std::ptrdiff_t>(kMaxWaiting) ? PlanFate::accepted : PlanFate::overfull;
}

PlanFate PlanBuffer::judge_pose(Instant now, const Plan& plan) const {
  if (!plan.pose || *plan.pose > now + max_ahead_) return PlanFate::without_pose;
  if (*plan.pose < newest_pose_) return PlanFate::older_pose;
  return std::min(*plan.pose, plan.stamp) + *max_age_ > now ? PlanFate::accepted : PlanFate::blind;
}

bool PlanBuffer::may_take_over(Instant now, const Plan& plan) const {
  if (session_held_) return false;
  if (plan.based_on >= 0) return false;
  const bool is_old =
      std::find(superseded_.begin(), superseded_.end(), plan.name.session) != superseded_.end();
  return !is_old || now - session_heard_ >= kSessionSilence;
}

bool PlanBuffer::is_consistent(Instant now, const Plan& plan) const {
  if (plan.based_on == Plan::kBasedOnAny) return true;
  const Instant takes_over = std::max(plan.start, now);
  const auto fits = [&plan, takes_over](const Entry* entry) {
    const bool other_session = entry == nullptr || entry->plan.name.session != plan.name.session;
    return plan.based_on == Plan::kBasedOnNone
               ? other_session
               : !other_session && is_base_of(plan, entry->plan, takes_over);
  };
  return fits(last_until(takes_over, true)) || fits(last_until(takes_over, false));
}

const PlanBuffer::Entry* PlanBuffer::last_until(Instant t, bool inclusive) const {
  const Entry* last = nullptr;
  for (const Entry& entry : schedule_) {
    if (entry.from > t || (!inclusive && entry.from == t)) break;
    last = &entry;
  }
  return last;
}

void PlanBuffer::insert(Instant now, Plan plan) {
  if (session_ != plan.name.session) {
    begin_session(plan.name.session);
    session_heard_ = now;
  }
  const Instant from = std::max(plan.start, now);
  while (!schedule_.empty() && schedule_.back().from >= from) schedule_.pop_back();
  while (schedule_.size() > 1 && schedule_[1].from <= now) schedule_.pop_front();
  schedule_.push_back({from, std::move(plan)});
}

void PlanBuffer::begin_session(std::int64_t session) {
  std::erase(superseded_, session);
  if (session_) superseded_.push_back(*session_);
  if (superseded_.size() > kSessions) superseded_.pop_front();
  session_ = session;
  ++sessions_;
}

std::optional<Twist> PlanBuffer::in_force(Instant now) const {
  const Entry* entry = last_until(now, true);
  if (entry == nullptr) return std::nullopt;
  const Plan& plan = entry->plan;
  const Instant end = plan.end();
  return now < end ? plan.at(now) : ramp_to_stop(plan.twists.back(), now - end, limits_);
}

Instant PlanBuffer::unchanged_until(Instant now) const {
  const auto next = std::find_if(schedule_.begin(), schedule_.end(),
                                 [now](const Entry& entry) { return entry.from > now; });
  const Instant takes_over = next == schedule_.end() ? Instant::max() : next->from;
  if (next == schedule_.begin()) return takes_over;
  const Plan& plan = std::prev(next)->plan;
  if (now < plan.end()) return std::min(takes_over, plan.end_of_twist(now));
  return stands_still(*in_force(now)) ? takes_over : now;
}

PlanName PlanBuffer::newest() const {
  return schedule_.empty() ? PlanName{} : schedule_.back().plan.name;
}

std::optional<Instant> PlanBuffer::end(Instant now) const {
  const Entry* entry = last_until(now, true);
  if (entry == nullptr) return std::nullopt;
  return entry->plan.end();
}

void PlanBuffer::list(CounterList& out) const {
  StreamGuard::Counters order;
  for (const StreamGuard& guard : guards_) {
    const StreamGuard::Counters& c = guard.counters();
    order.duplicated += c.duplicated;
    order.reordered += c.reordered;
    order.time_backwards += c.time_backwards;
    order.from_future += c.from_future;
    order.invalid_seq += c.invalid_seq;
    order.before_start += c.before_start;
    order.jumped += c.jumped;
    if (__builtin_add_overflow(order.missed, c.missed, &order.missed)) order.missed = INT64_MAX;
  }
  const std::pair<const char*, std::int64_t> all[] = {
      {"received", std::accumulate(counts_.begin(), counts_.end(), std::int64_t{0})},
      {"accepted", count(PlanFate::accepted)},
      {"unusable", count(PlanFate::unusable)},
      {"bad_step", count(PlanFate::bad_step)},
      {"too_long", count(PlanFate::too_long)},
      {"other_session", count(PlanFate::other_session)},
      {"duplicated", order.duplicated},
      {"reordered", order.reordered},
      {"time_backwards", order.time_backwards},
      {"from_future", order.from_future},
      {"invalid_seq", order.invalid_seq},
      {"before_start", order.before_start},
      {"repeated", count(PlanFate::repeated)},
      {"too_early", count(PlanFate::too_early)},
      {"expired", count(PlanFate::expired)},
      {"inconsistent", count(PlanFate::inconsistent)},
      {"overfull", count(PlanFate::overfull)},
      {"before_stop", count(PlanFate::before_stop)},
      {"without_pose", count(PlanFate::without_pose)},
      {"older_pose", count(PlanFate::older_pose)},
      {"blind", count(PlanFate::blind)},
      {"missed", order.missed},
      {"sessions", sessions_}};
  for (const auto& [name, value] : all) out.emplace_back(std::string("plan.") + name, value);
  if (order.jumped > 0) out.emplace_back("plan.jumped", order.jumped);
}

Actuator::Actuator(const ActuatorSettings& config, const VehicleConfig& vehicle,
                   const StreamGuard::Config& guard)
    : timeout_(from_seconds(config.timeout_s)),
      policy_(&kind_of(config)),
      limits_(stop_limits(config, vehicle)),
      plans_(limits_, guard),
      config_(config) {}

void Actuator::on_command(Instant now, const Twist& command) {
  command_ = command;
  arrival_ = now;
  any_command_ = true;
  plans_.clear();
}

bool Actuator::on_plan(Instant now, PlanSource source, Plan plan) {
  if (!takes_plans()) {
    ++unasked_plans_;
    return false;
  }
  return plans_.offer(now, source, std::move(plan)) == PlanFate::accepted;
}

Twist Actuator::in_force(Instant now) const {
  if (!plans_.empty()) {
    if (const auto planned = plans_.in_force(now)) return *planned;
  }
  return command_in_force(now);
}

Twist Actuator::command_in_force(Instant now) const {
  const Duration since = now - arrival_ - timeout_;
  if (policy_->after_timeout == nullptr || since < Duration{0}) return command_;
  return policy_->after_timeout(command_, since, config_, limits_);
}

Instant Actuator::unchanged_until(Instant now) const {
  const Instant by_plans = plans_.unchanged_until(now);
  if (policy_->after_timeout == nullptr || plans_.end(now)) return by_plans;
  if (now - arrival_ < timeout_) return std::min(by_plans, arrival_ + timeout_);
  return stands_still(command_in_force(now)) ? by_plans : now;
}

std::optional<Duration> Actuator::plan_age(Instant now) const {
  if (const auto end = plans_.end(now)) return std::max(Duration{0}, now - *end);
  if (!any_command_ && !plans_.empty()) return Duration{0};
  return std::nullopt;
}

void Actuator::list(CounterList& out) const {
  if (takes_plans()) {
    plans_.list(out);
  } else if (unasked_plans_ > 0) {
    out.emplace_back("plan.unasked", unasked_plans_);
  }
}

}  // namespace tether
