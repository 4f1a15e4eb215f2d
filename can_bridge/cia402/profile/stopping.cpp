#include "can_bridge/cia402/profile/stopping.hpp"

#include <fmt/format.h>

namespace tether::cia402 {
namespace {

constexpr Duration kStopTimeout = std::chrono::seconds(5);

}  // namespace

void Stopping::begin(StopKind kind) {
  d_.stage.enter(Stage::stopping);
  kind_ = kind;
  braking_ = true;
}

std::uint16_t Stopping::controlword(std::size_t i) const {
  return braking_ ? d_.axes.braking_controlword(i) : canopen::kControlDisableVoltage;
}

std::optional<Fault> Stopping::tick(Instant now) {
  if (braking_) {
    brake(now);
    return std::nullopt;
  }
  if (d_.axes.confirmed_off()) {
    d_.stage.enter(Stage::standby);
    d_.axes.release();
    return std::nullopt;
  }
  if (d_.stage.elapsed(now) < d_.step_timeout()) return std::nullopt;
  const Axis& axis = d_.axes[d_.axes[0].confirmed_off() ? 1 : 0];
  return Fault{fmt::format(
      "{}: is still in {} {} ms after the command to switch its power stage off: switch off its "
      "supply",
      axis.name(), canopen::to_string(axis.state()), d_.config.step_timeout_ms)};
}

void Stopping::brake(Instant now) {
  const bool first = d_.stage.elapsed(now) == Duration{0};
  const bool at_once = first && kind_ == StopKind::disable;
  // A quick stop is sent at least once.
  bool still = at_once || !first;
  for (std::size_t i = 0; i < d_.axes.size(); ++i) {
    still = still && (at_once ? d_.axes.stands(i, now) : d_.axes.confirmed_standing(i, now));
  }
  if (still) {
    braking_ = false;
    d_.stage.restart(now);
    d_.stage.tell("");
  } else if (d_.stage.elapsed(now) >= kStopTimeout) {
    d_.stage.tell(overdue_text(now));
  }
}

std::string Stopping::overdue_text(Instant now) const {
  for (std::size_t i = 0; i < d_.axes.size(); ++i) {
    if (d_.axes.stands(i, now)) continue;
    if (!d_.axes[i].fresh(now)) return d_.axes.feedback_text(i) + "; stop stays commanded";
    return fmt::format(
        "{}: its wheel still turns {:g} s after the quick stop: check brake and "
        "load; stop stays commanded",
        d_.axes[i].name(), to_seconds(kStopTimeout));
  }
  return "";
}

}  // namespace tether::cia402
