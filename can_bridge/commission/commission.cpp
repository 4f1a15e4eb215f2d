#include "can_bridge/commission/commission.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/cia402/config.hpp"
#include "can_bridge/cia402/profile.hpp"

namespace tether {
namespace {

using std::chrono::milliseconds;

constexpr int kMostResets = 3;

}  // namespace

Commission::Commission(const Cia402Config& config, const VehicleConfig& vehicle,
                       const Options& options, Instant now)
    : config_(config), vehicle_(vehicle), options_(options), since_(now) {
  record_.wheels = options.wheels_free ? "free" : "on the floor";
  record_.speed_mps = options.speed_mps;
  record_.settings = commissioned_settings(config, vehicle.wheel_radius_m);
  profile_ = make_profile(config, vehicle);
}

std::vector<CanFilter> Commission::filters() const { return profile_->filters(); }

bool Commission::may_move() const { return step_ == Step::driving || step_ == Step::acting; }

void Commission::on_frame(const CanFrame& frame, Instant now) {
  if (step_ == Step::listening) {
    if (frame.id == canopen::kHeartbeat + config_.master_node) {
      fail(fmt::format("another bridge or master runs on this bus (heartbeat 0x{:03X}): stop it",
                       frame.id),
           now);
      step_ = Step::done;
    }
    return;
  }
  const bool is_sdo = (frame.id & 0x780) == canopen::kSdoResponse;
  if (is_sdo && step_ == Step::reading) return reader_->on_frame(frame);
  if (is_sdo && step_ == Step::acting && withholds()) {
    for (PositionPoll& poll : polls_) poll.on_frame(frame, now);
    return;
  }
  if (step_ == Step::acting && withholds()) note_feedback(frame, now);
  profile_->on_frame(frame, now);
}

void Commission::tick(Instant now, std::vector<CanFrame>& out) {
  if (step_ != Step::listening && step_ != Step::done) snapshot_ = profile_->snapshot(now);
  switch (step_) {
    case Step::listening:
      if (elapsed(now) >= kListen) begin_trial(now);
      return;
    case Step::starting:
      start(now);
      break;
    case Step::reading:
      read(now, out);
      break;
    case Step::enabling:
      enable(now);
      break;
    case Step::driving:
      drive(now);
      break;
    case Step::acting:
      act(now, out);
      if (step_ == Step::acting && withholds()) return;
      break;
    case Step::stopping:
      stop(now);
      break;
    case Step::cutting:
      return cut_power(now, out);
    case Step::done:
      return;
  }
  run_profile(now, out);
}

void Commission::run_profile(Instant now, std::vector<CanFrame>& out) {
  if (step_ == Step::done || step_ == Step::cutting) return;
  const std::size_t first = out.size();
  profile_->tick(now, out);
  going_on_.clear();
  for (std::size_t i = first; i < out.size(); ++i) {
    const std::uint32_t function = out[i].id & 0x780;
    const bool is_process_data = function >= 0x200 && function < canopen::kSdoResponse;
    if (is_process_data || out[i].id == canopen::kSync) going_on_.push_back(out[i]);
  }
}

void Commission::enter(Step step, Instant now) {
  step_ = step;
  since_ = now;
}

void Commission::fail(const std::string& why, Instant now) {
  if (failure_.empty()) failure_ = why;
  if (step_ >= Step::stopping) return;
  profile_->set_command({});
  profile_->stop(StopKind::quick);
  enter(Step::stopping, now);
}

void Commission::abort() {
  if (step_ == Step::listening) step_ = Step::done;
  fail("interrupted", since_);
}

// A new profile for each trial: whatever the drives did in the last one, they start up again.
void Commission::begin_trial(Instant now) {
  profile_ = make_profile(config_, vehicle_);
  profile_->start(now);
  resets_ = 0;
  enter(Step::starting, now);
}

void Commission::start(Instant now) {
  switch (snapshot_.phase) {
    case DrivePhase::standby:
      if (!reader_) {
        reader_.emplace(recorded_objects(config_));
        return enter(Step::reading, now);
      }
      profile_->enable();
      return enter(Step::enabling, now);
    case DrivePhase::refused:
      return fail(snapshot_.reason, now);
    case DrivePhase::faulted:
      if (++resets_ > kMostResets) return fail(snapshot_.reason, now);
      profile_->reset_fault();
      break;
    default:
      break;
  }
  if (elapsed(now) >= kMostStart) fail("the drives do not start up: " + snapshot_.reason, now);
}

void Commission::read(Instant now, std::vector<CanFrame>& out) {
  if (snapshot_.phase == DrivePhase::faulted) return fail(snapshot_.reason, now);
  reader_->tick(now, out);
  if (!reader_->done()) return;
  record_.objects = reader_->values();
  if (const int node = reader_->silent_node(); node != 0) {
    return fail(fmt::format("node {} does not answer all SDO requests", node), now);
  }
  profile_->enable();
  enter(Step::enabling, now);
}

void Commission::enable(Instant now) {
  if (snapshot_.phase == DrivePhase::enabled) {
    steady_.reset();
    integral_m_ = {};
    last_tick_.reset();
    return enter(Step::driving, now);
  }
  if (snapshot_.phase == DrivePhase::faulted || elapsed(now) >= kMostStop) {
    fail("the drives cannot be switched on: " + snapshot_.reason, now);
  }
}

double Commission::way_m(std::size_t axis) const {
  return snapshot_.wheels[axis].angle_rad * vehicle_.wheel_radius_m;
}

void Commission::drive(Instant now) {
  if (snapshot_.phase != DrivePhase::enabled) return fail(snapshot_.reason, now);
  profile_->set_command({direction() * options_.speed_mps, 0.0});
  const double dt = last_tick_ ? to_seconds(now - *last_tick_) : 0.0;
  last_tick_ = now;
  for (std::size_t i = 0; i < 2; ++i) {
    integral_m_[i] += snapshot_.wheels[i].speed_radps * vehicle_.wheel_radius_m * dt;
  }
  if (!steady_ && elapsed(now) >= kSteady / 2) {
    steady_ = Mark{now, {way_m(0), way_m(1)}, integral_m_};
  }
  if (elapsed(now) < kSteady) return;
  for (std::size_t i = 0; i < 2; ++i) {
    steady_mps_[i] = (way_m(i) - steady_->way_m[i]) / to_seconds(now - steady_->stamp);
  }
  if (trial() == Trial::feedback) judge_feedback(now);
  if (step_ != Step::driving) return;
  steady_ = Mark{now, {way_m(0), way_m(1)}, {}};
  stood_ = {};
  reports_ = {};
  polls_.clear();
  for (const AxisConfig& axis : config_.axes) polls_.emplace_back(axis, vehicle_.wheel_radius_m);
  enter(trial() == Trial::feedback ? Step::stopping : Step::acting, now);
  if (!withholds()) profile_->set_command({});
  if (trial() == Trial::quick_stop) profile_->stop(StopKind::quick);
}

void Commission::act(Instant now, std::vector<CanFrame>& out) {
  if (withholds()) return withhold(now, out);
  for (std::size_t i = 0; i < 2; ++i) {
    const WheelFeedback& wheel = snapshot_.wheels[i];
    const bool stands = std::abs(wheel.speed_radps) < config_.standstill_radps;
    if (stands && !stood_[i]) stood_[i] = wheel.stamp;
  }
  if ((stood_[0] && stood_[1]) || elapsed(now) >= kMostWait) judge_quick_stop(now);
}

void Commission::note_feedback(const CanFrame& frame, Instant now) {
  if (elapsed(now) < milliseconds(config_.feedback_timeout_ms)) return;
  for (const PdoConfig& pdo : config_.pdos) {
    if (!pdo.transmit || frame.id != canopen::pdo_id(true, pdo.number, pdo.node)) continue;
    for (std::size_t i = 0; i < 2; ++i) {
      reports_[i] = reports_[i] || config_.axes[i].node == pdo.node;
    }
  }
}

bool Commission::is_withheld(const CanFrame& frame) const {
  const bool is_sync = frame.id == canopen::kSync;
  const bool is_heartbeat = frame.id == canopen::kHeartbeat + config_.master_node;
  switch (trial()) {
    case Trial::silence:
      return true;
    case Trial::heartbeat:
      return is_heartbeat;
    case Trial::sync:
      return is_sync;
    case Trial::setpoints:
      return !is_sync && !is_heartbeat;
    case Trial::feedback:
    case Trial::quick_stop:
      break;
  }
  return false;
}

void Commission::withhold(Instant now, std::vector<CanFrame>& out) {
  bool all_stand = true;
  for (std::size_t i = 0; i < polls_.size(); ++i) {
    stood_[i] = polls_[i].stands_since(now);
    all_stand = all_stand && stood_[i];
  }
  if (all_stand || elapsed(now) >= kMostWait) {
    judge_withheld(now);
    profile_->stop(StopKind::quick);
    return enter(Step::stopping, now);
  }
  std::vector<CanFrame> frames = going_on_;
  frames.push_back(canopen::heartbeat_frame(config_.master_node, canopen::NmtState::operational));
  for (const CanFrame& frame : frames) {
    if (!is_withheld(frame)) out.push_back(frame);
  }
  // Two axes of one node share its SDO server: they take turns.
  const bool shared = config_.axes[0].node == config_.axes[1].node;
  for (std::size_t i = 0; i < polls_.size(); ++i) {
    const bool turn = !shared || (elapsed(now) / options_.cycle) % 4 / 2 == static_cast<int>(i);
    const bool quiet = hears_any_frame(i) && elapsed(now) < kQuiet;
    if (turn && !quiet) polls_[i].tick(now, out);
  }
}

void Commission::stop(Instant now) {
  const bool off = snapshot_.phase == DrivePhase::standby ||
                   snapshot_.phase == DrivePhase::faulted || snapshot_.phase == DrivePhase::refused;
  const bool stands = snapshot_.feedback_fresh && snapshot_.standstill;
  const bool safe =
      off && !snapshot_.in_doubt && (stands || snapshot_.phase != DrivePhase::standby);
  if (snapshot_.phase == DrivePhase::enabled || snapshot_.phase == DrivePhase::enabling) {
    // Not yet by a quick stop, which has not been tried.
    const bool gently = trial() == Trial::feedback && failure_.empty();
    if (gently && !stands && elapsed(now) < kMostWait) return;
    profile_->stop(gently && stands ? StopKind::disable : StopKind::quick);
  }
  if (!safe && elapsed(now) < kMostStop) return;
  if (!safe) {
    failure_ = "the wheels are not known to stand: use the hard-wired emergency stop; " +
               (snapshot_.reason.empty() ? failure_ : snapshot_.reason);
    for (std::size_t i = 0; i < 2; ++i) add(i, "not known to stand afterwards", failure_);
    return enter(Step::cutting, now);
  }
  if (!failure_.empty() || ++trial_ == kTrials.size()) {
    trial_ = std::min(trial_, kTrials.size() - 1);
    return enter(Step::done, now);
  }
  begin_trial(now);
}

// The last resort at such speeds: the wheel coasts. By SDO, because RPDOs would need the profile,
// which goes on commanding the quick stop.
void Commission::cut_power(Instant now, std::vector<CanFrame>& out) {
  for (const AxisConfig& axis : config_.axes) {
    out.push_back(
        canopen::sdo_download(axis.node, axis.controlword, canopen::kControlDisableVoltage));
  }
  if (elapsed(now) >= kMostWait) enter(Step::done, now);
}

std::string Commission::progress() const {
  const char* name = trial_name(trial());
  switch (step_) {
    case Step::listening:
      return "listening for another master";
    case Step::starting:
      return fmt::format("{}: starting the drives up", name);
    case Step::reading:
      return "reading identities and objects";
    case Step::enabling:
      return fmt::format("{}: switching the drives on", name);
    case Step::driving:
      return fmt::format("{}: driving {}", name, direction() > 0 ? "forward" : "backward");
    case Step::acting:
      return fmt::format("{}: measuring", name);
    case Step::stopping:
      return fmt::format("{}: stopping", name);
    case Step::cutting:
      return fmt::format("{}: the wheels turn on: cutting their power", name);
    case Step::done:
      return "done";
  }
  return "";
}

}  // namespace tether
