#include "can_bridge/cia402/startup.hpp"

#include <algorithm>
#include <cassert>

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/cia402/config.hpp"
#include "can_bridge/cia402/pdo_objects.hpp"
#include "can_bridge/cia402/stop_objects.hpp"

namespace tether::cia402 {
namespace {

constexpr std::int64_t kPdoOff = 0x80000000;
// Bit 30 (no remote requests) is the drive's own choice.
constexpr std::uint32_t kNoRemote = 0x40000000;

SdoStep write_only(const ObjectRef& object, std::int64_t value, std::string meaning) {
  SdoStep step;
  step.object = object;
  step.write = value;
  step.meaning = std::move(meaning);
  return step;
}

SdoStep read_only(const ObjectRef& object, std::int64_t expected, std::string meaning) {
  SdoStep step;
  step.object = step.read_back = object;
  step.check = SdoStep::Check::equal;
  step.expected = expected;
  step.meaning = std::move(meaning);
  return step;
}

SdoStep write_and_read(const ObjectRef& object, std::int64_t value, std::string meaning) {
  SdoStep step = read_only(object, value, std::move(meaning));
  step.write = value;
  return step;
}

SdoStep device_type() {
  SdoStep step = read_only({0x1000, 0, 4, false}, 0, "device type");
  step.check = SdoStep::Check::drive_profile;
  return step;
}

SdoStep keep_bit_30(const ObjectRef& object, std::string meaning) {
  SdoStep step = read_only(object, 0, std::move(meaning));
  step.check = SdoStep::Check::keep;
  step.mask = kNoRemote;
  return step;
}

SdoStep watchdog_step(const Cia402Config& config, const WatchdogConfig& watchdog) {
  const bool consumer = watchdog.kind == WatchdogConfig::Kind::heartbeat_consumer;
  SdoStep step = write_and_read(watchdog.object, config.value_of(watchdog),
                                consumer ? "heartbeat consumer" : "watchdog");
  step.need = SdoStep::Need::watchdog;
  return step;
}

SdoStep event_timer_step(const PdoConfig& pdo) {
  SdoStep step = write_and_read(PdoObjects(pdo).event_timer(), pdo.event_timer_ms,
                                pdo_name(pdo) + (pdo.transmit ? " event timer" : " deadline"));
  if (!pdo.transmit && !pdo.event_timer_required) step.need = SdoStep::Need::optional;
  return step;
}

void add_pdo(const PdoConfig& pdo, std::vector<SdoStep>& steps) {
  assert(pdo.number >= 1 && pdo.number <= 4 && pdo.objects.size() <= 8);
  const PdoObjects o(pdo);
  const std::string name = pdo_name(pdo);
  const std::int64_t id = canopen::pdo_id(pdo.transmit, pdo.number, pdo.node);
  const auto count = static_cast<std::int64_t>(pdo.objects.size());
  if (!pdo.preset) {
    steps.push_back(keep_bit_30(o.id(), name + " identifier"));
    steps.push_back(write_only(o.id(), kPdoOff | id, name + " off"));
    steps.push_back(write_only(o.count(), 0, name + " mapping cleared"));
    for (std::size_t i = 0; i < pdo.objects.size(); ++i) {
      steps.push_back(write_only(o.entry(i), mapping_entry(pdo.objects[i]), name + " mapping"));
    }
    steps.push_back(write_only(o.count(), count, name + " mapping count"));
    steps.push_back(write_only(o.transmission(), pdo.transmission, name + " transmission type"));
  }
  if (pdo.event_timer_ms != 0) steps.push_back(event_timer_step(pdo));
  if (!pdo.preset) steps.push_back(write_only(o.id(), id, name + " on"));

  steps.push_back(read_only(o.id(), id, name + " identifier"));
  steps.back().mask = ~kNoRemote;
  steps.push_back(read_only(o.count(), count, name + " mapping count"));
  for (std::size_t i = 0; i < pdo.objects.size(); ++i) {
    steps.push_back(read_only(o.entry(i), mapping_entry(pdo.objects[i]), name + " mapping"));
  }
  steps.push_back(read_only(o.transmission(), pdo.transmission, name + " transmission type"));
}

void add_modes(const Cia402Config& config, std::uint8_t node, std::vector<SdoStep>& steps) {
  std::vector<ObjectRef> done;
  for (const AxisConfig& axis : config.axes) {
    if (axis.node != node || std::ranges::find(done, axis.mode) != done.end()) continue;
    done.push_back(axis.mode);
    SdoStep step = write_and_read(axis.mode, kProfileVelocity, "mode of operation");
    step.read_back = axis.mode_display;
    step.check = SdoStep::Check::eventually_equal;
    if (config.tells_mode(axis)) step.need = SdoStep::Need::later;
    steps.push_back(step);
  }
}

}  // namespace

std::vector<SdoStep> startup_steps(const Cia402Config& config, std::uint8_t node) {
  std::vector<SdoStep> steps{device_type()};
  for (const WatchdogConfig& watchdog : config.watchdogs) {
    if (watchdog.node == node) steps.push_back(watchdog_step(config, watchdog));
  }
  steps.push_back(
      write_and_read({0x1017, 0, 2, false}, config.drive_heartbeat_ms, "heartbeat producer"));
  for (const WatchdogConfig& watchdog : config.watchdogs) {
    if (watchdog.node != node || !watchdog.reaction) continue;
    steps.push_back(
        write_and_read(*watchdog.reaction, watchdog.reaction_value, "reaction of the watchdog"));
  }
  for (const SetupWrite& setup : config.setup) {
    if (setup.node != node) continue;
    steps.push_back(write_and_read(setup.object, setup.value, setup.meaning));
    if (!setup.required) steps.back().need = SdoStep::Need::optional;
  }
  for (const PdoConfig& pdo : config.pdos) {
    if (pdo.node == node) add_pdo(pdo, steps);
  }
  add_modes(config, node, steps);
  return steps;
}

bool is_vital(const Cia402Config& config, std::uint8_t node, std::uint16_t index) {
  if (stop_part(index) != StopPart::none) return true;
  for (const AxisConfig& axis : config.axes) {
    if (axis.node == node &&
        (axis.controlword.index == index || axis.target_velocity.index == index)) {
      return true;
    }
  }
  return std::ranges::any_of(startup_steps(config, node),
                             [index](const SdoStep& step) { return step.object.index == index; });
}

}  // namespace tether::cia402
