#include "can_bridge/cia402/standstill.hpp"

#include <algorithm>
#include <cmath>

namespace tether::cia402 {
namespace {

using canopen::DriveState;

constexpr Duration kPoweredStandstill = std::chrono::milliseconds(500);

}  // namespace

bool is_power_off(std::optional<DriveState> state) {
  return state == DriveState::not_ready || state == DriveState::switch_on_disabled ||
         state == DriveState::ready_to_switch_on || state == DriveState::fault;
}

bool obeys_quick_stop(std::optional<DriveState> state) {
  return is_power_off(state) || state == DriveState::quick_stop_active ||
         state == DriveState::fault_reaction;
}

StandstillInquiry::StandstillInquiry(const Cia402Config& config, std::uint8_t node,
                                     Duration timeout)
    : config_(config), sdo_(node, timeout, config.sdo_retries), round_(timeout) {
  for (std::size_t axis = 0; axis < config.axes.size(); ++axis) {
    if (config.axes[axis].node == node) readings_.push_back(blank(axis));
  }
  add_questions(Asked::controlword, &AxisConfig::controlword);
  add_questions(Asked::statusword, &AxisConfig::statusword);
  add_questions(Asked::velocity, &AxisConfig::actual_velocity);
  add_questions(Asked::position, &AxisConfig::actual_position);
  for (const WatchdogConfig& watchdog : config.watchdogs) {
    if (watchdog.node != node || questions_.back().asked == Asked::watchdog) continue;
    watchdog_ = config.value_of(watchdog);
    questions_.push_back({Asked::watchdog, 0, watchdog.object});
  }
  round_ = timeout * static_cast<int>(questions_.size());
  for (Reading& reading : readings_) reading = blank(reading.axis);
}

StandstillInquiry::Reading StandstillInquiry::blank(std::size_t axis) const {
  return {.axis = axis, .witness = Axis(config_.axes[axis], "", round_, config_.standstill_radps)};
}

void StandstillInquiry::add_questions(Asked asked, const ObjectRef AxisConfig::*object) {
  for (std::size_t i = 0; i < readings_.size(); ++i) {
    questions_.push_back({asked, i, config_.axes[readings_[i].axis].*object});
  }
}

void StandstillInquiry::begin(bool stop_first) {
  sdo_.cancel();
  stop_first_ = stop_first;
  asks_watchdog_ = !stop_first;
  for (Reading& reading : readings_) reading = blank(reading.axis);
  question_ = 0;
  configured_ = repeated_ = false;
  told_.reset();
  told_after_ = Duration{0};
  verdict_ = Verdict::unknown;
  silent_since_.reset();
  fastest_.reset();
  standing_since_.reset();
  news_.clear();
}

void StandstillInquiry::tick(Instant now, const std::array<std::uint16_t, 2>& stop_words,
                             std::vector<CanFrame>& out) {
  if (const auto result = sdo_.take_result()) on_result(*result, now);
  if (!sdo_.busy()) ask(stop_words);
  sdo_.tick(now, out);
  if (sdo_.tries() > 1) on_repeat();
  if (const auto result = sdo_.take_result()) on_result(*result, now);
  lapse(now);
}

void StandstillInquiry::lapse(Instant now) {
  if (verdict_ != Verdict::standing || !told_ || now - *told_ <= told_after_) return;
  verdict_ = Verdict::unknown;
}

void StandstillInquiry::on_repeat() {
  repeated_ = true;
  standing_since_.reset();
}

bool StandstillInquiry::obeys() const {
  return verdict_ != Verdict::silent && std::ranges::all_of(readings_, [](const Reading& reading) {
           return obeys_quick_stop(reading.state);
         });
}

void StandstillInquiry::ask(const std::array<std::uint16_t, 2>& stop_words) {
  while (!is_due(questions_[question_], stop_words)) ++question_;
  const Question& question = questions_[question_];
  if (question.asked != Asked::controlword) return sdo_.read(question.object);
  ++writes_;
  sdo_.write(question.object, stop_words[readings_[question.reading].axis]);
}

// Optional questions stand before those that are always due, or at the end of the round: see
// on_result().
bool StandstillInquiry::is_due(const Question& question,
                               const std::array<std::uint16_t, 2>& stop_words) const {
  const Reading& reading = readings_[question.reading];
  switch (question.asked) {
    case Asked::controlword:
      return has_to_write(reading, stop_words[reading.axis]);
    case Asked::watchdog:
      return asks_watchdog_;
    case Asked::statusword:
    case Asked::velocity:
    case Asked::position:
      break;
  }
  return true;
}

bool StandstillInquiry::has_to_write(const Reading& reading, std::uint16_t stop_word) const {
  if (!reading.asked) return stop_first_;
  return stop_word == canopen::kControlDisableVoltage ? !is_power_off(reading.state)
                                                      : !obeys_quick_stop(reading.state);
}

void StandstillInquiry::on_result(const SdoResult& result, Instant now) {
  if (result.outcome == SdoResult::Outcome::no_answer &&
      questions_[question_].asked == Asked::watchdog) {
    asks_watchdog_ = configured_ = repeated_ = false;
    question_ = 0;
    return;
  }
  if (result.outcome == SdoResult::Outcome::no_answer) {
    verdict_ = Verdict::silent;
    silent_since_ = silent_since_.value_or(now);
    configured_ = false;
    standing_since_.reset();
    question_ = 0;
    return;
  }
  silent_since_.reset();
  note(questions_[question_], result, now);
  ++question_;
  const bool is_last = question_ == questions_.size() ||
                       (!asks_watchdog_ && questions_[question_].asked > Asked::position);
  if (!is_last) return;
  question_ = 0;
  judge(now);
  repeated_ = false;
}

void StandstillInquiry::note(const Question& question, const SdoResult& result, Instant now) {
  const bool told = result.outcome == SdoResult::Outcome::done;
  Reading& reading = readings_[question.reading];
  switch (question.asked) {
    case Asked::controlword:
      return;
    case Asked::statusword:
      return on_statusword(reading, result);
    case Asked::velocity:
      return on_velocity(reading, result, now);
    case Asked::watchdog:
      configured_ = told && result.value == watchdog_;
      return;
    case Asked::position:
      return on_position(reading, result, now);
  }
}

std::optional<std::int64_t> StandstillInquiry::position(std::size_t axis) const {
  for (const Reading& reading : readings_) {
    if (reading.axis == axis && configured_) return reading.position;
  }
  return std::nullopt;
}

void StandstillInquiry::on_statusword(Reading& reading, const SdoResult& result) {
  const bool told = result.outcome == SdoResult::Outcome::done;
  const AxisConfig& axis = config_.axes[reading.axis];
  reading.asked = true;
  reading.state.reset();
  if (told) {
    const auto word = static_cast<std::uint16_t>(result.value >> axis.statusword_shift & 0xFFFF);
    reading.state = canopen::drive_state(word);
    news_.push_back({{Signal::statusword, reading.axis, axis.statusword, 0}, result.value});
  }
  reading.power_off = is_power_off(reading.state);
}

void StandstillInquiry::on_velocity(Reading& reading, const SdoResult& result, Instant now) {
  if (reading.axis == readings_.front().axis) {
    told_after_ = told_ ? now - *told_ : Duration{0};
    told_ = now;
  }
  reading.speed_radps.reset();
  if (result.outcome != SdoResult::Outcome::done) return;
  const AxisConfig& axis = config_.axes[reading.axis];
  const PdoMap::Field field{Signal::actual_velocity, reading.axis, axis.actual_velocity, 0};
  reading.witness.receive(field, result.value, now);
  reading.speed_radps = reading.witness.feedback().speed_radps;
  news_.push_back({field, result.value});
}

void StandstillInquiry::on_position(Reading& reading, const SdoResult& result, Instant now) {
  reading.position.reset();
  if (result.outcome != SdoResult::Outcome::done) return;
  const AxisConfig& axis = config_.axes[reading.axis];
  reading.position = result.value;
  reading.witness.see_position(result.value, now);
  news_.push_back({{Signal::actual_position, reading.axis, axis.actual_position, 0}, result.value});
}

void StandstillInquiry::judge(Instant now) {
  bool standing = true, turning = false, complete = true, power_off = true;
  fastest_.reset();
  for (const Reading& reading : readings_) {
    const Motion motion = reading.witness.motion(now);
    power_off = power_off && reading.power_off;
    const bool told = reading.speed_radps && reading.position && !repeated_;
    standing = standing && told && motion == Motion::standing;
    turning = turning || motion == Motion::turning;
    complete = complete && told;
    const double speed_radps = reading.witness.fastest_radps(now).value_or(0.0);
    if (!fastest_ || std::abs(speed_radps) > std::abs(fastest_->speed_radps)) {
      fastest_ = Wheel{reading.axis, speed_radps};
    }
  }
  if (!standing) {
    standing_since_.reset();
  } else if (!standing_since_) {
    standing_since_ = now;
  }
  const bool long_enough = standing && (power_off || now - *standing_since_ >= kPoweredStandstill);
  if (long_enough) {
    verdict_ = Verdict::standing;
  } else if (turning || standing) {
    verdict_ = Verdict::turning;
  } else {
    verdict_ = complete ? Verdict::unknown : Verdict::unconfirmed;
  }
}

}  // namespace tether::cia402
