#include "can_bridge/cia402/startup.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>

#include "can_bridge/canopen/canopen.hpp"

namespace tether::cia402 {
namespace {

constexpr std::int64_t kPdoOff = 0x80000000;
// Bit 30 (no RTR) may be the drive's own choice.
constexpr std::uint32_t kPdoIdMask = 0xBFFFFFFF;

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

SdoStep watchdog_step(const Cia402Config& config, const WatchdogConfig& watchdog) {
  const bool consumer = watchdog.kind == WatchdogConfig::Kind::heartbeat_consumer;
  const std::int64_t producer = consumer ? config.master_node : 0;
  SdoStep step = write_and_read(watchdog.object, producer << 16 | watchdog.timeout_ms,
                                consumer ? "heartbeat consumer" : "watchdog");
  step.need = SdoStep::Need::watchdog;
  return step;
}

/// The objects 0x1400…, 0x1600… of a PDO, or 0x1800…, 0x1A00….
struct PdoObjects {
  explicit PdoObjects(const PdoConfig& pdo)
      : communication(
            static_cast<std::uint16_t>((pdo.transmit ? 0x1800 : 0x1400) + pdo.number - 1)),
        mapping(static_cast<std::uint16_t>(communication + 0x200)),
        name(fmt::format("{}PDO{}", pdo.transmit ? "T" : "R", pdo.number)) {}

  ObjectRef id() const { return {communication, 1, 4, false}; }
  ObjectRef transmission() const { return {communication, 2, 1, false}; }
  ObjectRef event_timer() const { return {communication, 5, 2, false}; }
  ObjectRef count() const { return {mapping, 0, 1, false}; }
  ObjectRef entry(std::size_t i) const {
    return {mapping, static_cast<std::uint8_t>(i + 1), 4, false};
  }

  std::uint16_t communication;
  std::uint16_t mapping;
  std::string name;
};

std::int64_t mapping_entry(const ObjectRef& object) {
  return std::int64_t{object.index} << 16 | object.sub << 8 | std::int64_t{object.bytes} * 8;
}

SdoStep event_timer_step(const PdoConfig& pdo, const PdoObjects& o) {
  SdoStep step = write_and_read(o.event_timer(), pdo.event_timer_ms,
                                o.name + (pdo.transmit ? " event timer" : " deadline"));
  if (!pdo.transmit && !pdo.event_timer_required) step.need = SdoStep::Need::optional;
  return step;
}

void add_pdo(const PdoConfig& pdo, std::vector<SdoStep>& steps) {
  assert(pdo.number >= 1 && pdo.number <= 4 && pdo.objects.size() <= 8);
  const PdoObjects o(pdo);
  const std::int64_t id = canopen::pdo_id(pdo.transmit, pdo.number, pdo.node);
  const auto count = static_cast<std::int64_t>(pdo.objects.size());
  if (!pdo.preset) {
    steps.push_back(write_only(o.id(), kPdoOff | id, o.name + " off"));
    steps.push_back(write_only(o.count(), 0, o.name + " mapping cleared"));
    for (std::size_t i = 0; i < pdo.objects.size(); ++i) {
      steps.push_back(write_only(o.entry(i), mapping_entry(pdo.objects[i]), o.name + " mapping"));
    }
    steps.push_back(write_only(o.count(), count, o.name + " mapping count"));
    steps.push_back(write_only(o.transmission(), pdo.transmission, o.name + " transmission type"));
  }
  if (pdo.event_timer_ms != 0) steps.push_back(event_timer_step(pdo, o));
  if (!pdo.preset) steps.push_back(write_only(o.id(), id, o.name + " on"));

  steps.push_back(read_only(o.id(), id, o.name + " identifier"));
  steps.back().mask = kPdoIdMask;
  steps.push_back(read_only(o.count(), count, o.name + " mapping count"));
  for (std::size_t i = 0; i < pdo.objects.size(); ++i) {
    steps.push_back(read_only(o.entry(i), mapping_entry(pdo.objects[i]), o.name + " mapping"));
  }
  steps.push_back(read_only(o.transmission(), pdo.transmission, o.name + " transmission type"));
}

void add_modes(const Cia402Config& config, std::uint8_t node, std::vector<SdoStep>& steps) {
  std::vector<ObjectRef> done;
  for (const AxisConfig& axis : config.axes) {
    if (axis.node != node || std::ranges::find(done, axis.mode) != done.end()) continue;
    done.push_back(axis.mode);
    SdoStep step = write_and_read(axis.mode, kProfileVelocity, "mode of operation");
    step.read_back = axis.mode_display;
    step.check = SdoStep::Check::eventually_equal;
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

}  // namespace tether::cia402
