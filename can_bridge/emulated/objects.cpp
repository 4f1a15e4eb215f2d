#include "can_bridge/emulated/objects.hpp"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <numbers>
#include <utility>

#include "can_bridge/bus/canopen.hpp"

namespace tether {
namespace {

using Access = ObjectDictionary::Access;
using Entry = ObjectDictionary::Entry;
using Handle = ObjectDictionary::Handle;
using Mapping = ObjectDictionary::Mapping;
constexpr Handle kNone = ObjectDictionary::kNone;

bool is_communication(std::uint16_t index) { return index >= 0x1000 && index <= 0x1FFF; }

class Builder {
 public:
  Builder(const Cia402Config& config, std::uint8_t node) : config_(config), node_(node) {}

  DriveObjects build() {
    add_communication_objects();
    for (std::size_t wheel = 0; wheel < config_.axes.size(); ++wheel) {
      if (config_.axes[wheel].node == node_) add_axis(wheel);
    }
    assert(!out_.axes.empty());
    share_error_code();
    add_watchdogs();
    for (const WatchdogConfig& watchdog : config_.watchdogs) {
      if (watchdog.node == node_ && watchdog.reaction) mention(*watchdog.reaction);
    }
    for (const SetupWrite& write : config_.setup) {
      if (write.node == node_) mention(write.object);
    }
    for (const PdoConfig& pdo : config_.pdos) {
      if (pdo.node != node_) continue;
      for (const ObjectRef& object : pdo.objects) mention(object);
    }
    for (AxisObjects& axis : out_.axes) add_companions(axis);
    if (const Handle h = dictionary().find(0x1029, 1); h != kNone) {
      limit(h, 0, 2, 0);
      out_.error_behaviour = h;
    }
    add_pdos();
    dictionary().close_records();
    return std::move(out_);
  }

 private:
  ObjectDictionary& dictionary() { return out_.dictionary; }

  /// The object, added unless it is there already.
  Handle ensure(const ObjectRef& ref, Access access, Mapping mapping, std::int64_t initial = 0) {
    if (const Handle h = dictionary().find(ref.index, ref.sub); h != kNone) return h;
    Entry entry;
    entry.ref = ref;
    entry.access = access;
    entry.mapping = mapping;
    entry.initial = initial;
    return dictionary().add(std::move(entry));
  }

  Handle constant(std::uint16_t index, std::uint8_t sub, std::uint8_t bytes, std::int64_t value) {
    return ensure({index, sub, bytes, false}, Access::read_only, Mapping::none, value);
  }
  Handle parameter(std::uint16_t index, std::uint8_t sub, std::uint8_t bytes, std::int64_t value) {
    return ensure({index, sub, bytes, false}, Access::read_write, Mapping::none, value);
  }

  void limit(Handle h, std::int64_t minimum, std::int64_t maximum, std::int64_t initial) {
    Entry& entry = dictionary().edit(h);
    entry.minimum = minimum;
    entry.maximum = maximum;
    entry.initial = initial;
    dictionary().store(h, initial);
  }

  void add_communication_objects() {
    constant(0x1000, 0, 4, 0x0002'0192);  // servo drive, CiA 402
    out_.error_register = ensure({0x1001, 0, 1, false}, Access::read_only, Mapping::transmit);
    constant(0x1005, 0, 4, canopen::kSync);
    Entry name;
    name.ref = {0x1008, 0, 0, false};
    name.access = Access::read_only;
    name.text = "Tether emulated drive";
    dictionary().add(name);
    constant(0x1014, 0, 4, canopen::kEmcy + node_);
    out_.heartbeat_time = parameter(0x1017, 0, 2, 0);
    constant(0x1018, 1, 4, 0);  // vendor: none
    constant(0x1018, 2, 4, 0x402);
    constant(0x1018, 3, 4, 0x0001'0000);
    constant(0x1018, 4, 4, node_);
    constant(0x1200, 1, 4, canopen::kSdoRequest + node_);
    constant(0x1200, 2, 4, canopen::kSdoResponse + node_);
  }

  void add_axis(std::size_t wheel) {
    const AxisConfig& c = config_.axes[wheel];
    AxisObjects a;
    a.wheel = wheel;
    a.sign = c.sign;
    constexpr double kRadians = 2.0 * std::numbers::pi;
    a.target_per_radps = c.target_velocity_per_rps.value() / kRadians;
    a.actual_per_radps = c.actual_velocity_per_rps.value() / kRadians;
    a.counts_per_rad = c.counts_per_revolution.value() / kRadians;
    a.statusword_shift = c.statusword_shift;

    a.controlword = ensure(c.controlword, Access::read_write, Mapping::both);
    a.statusword = ensure(c.statusword, Access::read_only, Mapping::transmit);
    a.mode = ensure(c.mode, Access::read_write, Mapping::both);
    limit(a.mode, 0, 3, 0);
    a.mode_display = ensure(c.mode_display, Access::read_only, Mapping::transmit);
    a.target_velocity = ensure(c.target_velocity, Access::read_write, Mapping::both);
    a.actual_velocity = ensure(c.actual_velocity, Access::read_only, Mapping::transmit);
    a.actual_position = ensure(c.actual_position, Access::read_only, Mapping::transmit);
    a.error_code = ensure(c.error_code, Access::read_only, Mapping::transmit);
    dictionary().edit(a.actual_velocity).measured = true;
    dictionary().edit(a.actual_position).measured = true;
    out_.axes.push_back(a);
  }

  /// Two axes with one 32-bit error code have a half each, as their statuswords have.
  void share_error_code() {
    if (out_.axes.size() < 2 || out_.axes[0].error_code != out_.axes[1].error_code) return;
    if (dictionary().entry(out_.axes[0].error_code).ref.bytes == 4) {
      out_.axes[1].error_code_shift = 16;
    }
  }

  void add_watchdogs() {
    for (const WatchdogConfig& w : config_.watchdogs) {
      if (w.node != node_) continue;
      if (w.kind == WatchdogConfig::Kind::heartbeat_consumer) {
        const Handle h = parameter(0x1016, w.object.sub, 4, 0);
        out_.heartbeat_consumers.push_back(h);
      } else {
        out_.watchdogs.push_back(ensure(w.object, Access::read_write, Mapping::none));
      }
    }
  }

  /// Adds an object that the configuration mentions, whatever it is.
  void mention(ObjectRef ref) {
    if (canopen::is_pdo_parameter(ref.index)) return;
    if (dictionary().find(ref.index, ref.sub) != kNone) return;
    if (is_communication(ref.index)) {
      if (ref.index == 0x1016) ref.bytes = 4;
      if (ref.index == 0x1029) ref.bytes = 1;
      const Handle h = ensure(ref, Access::read_write, Mapping::none);
      if (ref.index == 0x1016) out_.heartbeat_consumers.push_back(h);
      return;
    }
    const auto [low, high] = halves(ref);
    const bool writable = low == kNone || dictionary().entry(low).access == Access::read_write;
    const Handle h = ensure(ref, writable ? Access::read_write : Access::read_only,
                            writable ? Mapping::both : Mapping::transmit);
    if (low == kNone) return;
    Entry& entry = dictionary().edit(h);
    entry.low_half = low;
    entry.high_half = high;
    entry.measured = dictionary().entry(low).measured;
  }

  std::pair<Handle, Handle> halves(const ObjectRef& packed) {
    if (packed.bytes != 4 || out_.axes.size() < 2) return {kNone, kNone};
    constexpr std::array kPackable{&AxisObjects::target_velocity, &AxisObjects::actual_velocity,
                                   &AxisObjects::actual_position, &AxisObjects::error_code,
                                   &AxisObjects::controlword,     &AxisObjects::statusword};
    for (const auto object : kPackable) {
      Handle low = out_.axes[0].*object;
      Handle high = out_.axes[1].*object;
      const ObjectRef& a = dictionary().entry(low).ref;
      const ObjectRef& b = dictionary().entry(high).ref;
      if (low == high || a.index != packed.index || b.index != packed.index) continue;
      if (a.sub > b.sub) std::swap(low, high);
      return {low, high};
    }
    return {kNone, kNone};
  }

  /// An axis' object of the standard's index `base`: beside its target velocity, or one for all
  /// subindices. kNone if it is in neither place.
  Handle find_companion(const AxisObjects& axis, std::uint16_t base) {
    const auto [index, sub] = companion_place(axis, base);
    for (const std::uint8_t s : {sub, std::uint8_t{0}}) {
      const Handle h = dictionary().find(index, s);
      if (h != kNone && dictionary().entry(h).access == Access::read_write) return h;
    }
    return kNone;
  }

  std::pair<std::uint16_t, std::uint8_t> companion_place(const AxisObjects& axis,
                                                         std::uint16_t base) {
    const ObjectRef& target = dictionary().entry(axis.target_velocity).ref;
    constexpr int kTargetVelocity = 0x60FF;
    constexpr int kAxisStep = 0x800;
    const int offset = target.index - kTargetVelocity;
    const bool standard = offset >= 0 && offset % kAxisStep == 0;
    return {static_cast<std::uint16_t>(base + (standard ? offset : 0)), target.sub};
  }

  Handle companion(const AxisObjects& axis, std::uint16_t base, double initial) {
    Handle h = find_companion(axis, base);
    const auto value = std::max<std::int64_t>(1, std::llround(initial));
    if (h == kNone) {
      const auto [index, sub] = companion_place(axis, base);
      h = ensure({index, sub, 4, false}, Access::read_write, Mapping::both);
    }
    limit(h, 1, INT64_MAX, value);
    return h;
  }

  Handle option(const AxisObjects& axis, std::uint16_t base, std::int64_t maximum,
                std::int64_t initial) {
    const Handle h = find_companion(axis, base);
    if (h != kNone) limit(h, 0, maximum, initial);
    return h;
  }

  void add_companions(AxisObjects& axis) {
    const double rps = axis.target_per_radps * 2.0 * std::numbers::pi;
    axis.max_speed = companion(axis, 0x607F, rps * 1000.0 / 60.0);
    axis.acceleration = companion(axis, 0x6083, rps * 2.0);
    axis.deceleration = companion(axis, 0x6084, rps * 2.0);
    axis.quick_stop_deceleration = companion(axis, 0x6085, rps * 4.0);
    axis.connection_option = option(axis, 0x6007, 3, 1);
    if (axis.connection_option == kNone) {  // the connection is the whole device's
      axis.connection_option = dictionary().find(0x6007, 0);
    }
    axis.quick_stop_option = option(axis, 0x605A, 6, 2);
    axis.fault_option = option(axis, 0x605E, 2, 2);
    const auto [index, sub] = companion_place(axis, 0x6502);
    ensure({index, sub, 4, false}, Access::read_only, Mapping::transmit, 0x04);  // pv only
  }

  void add_pdos() {
    for (int number = 1; number <= 4; ++number) {
      add_pdo(false, number);
      add_pdo(true, number);
    }
  }

  void add_pdo(bool transmit, int number) {
    const auto offset = static_cast<std::uint16_t>((transmit ? 0x400 : 0) + number - 1);
    const auto communication = static_cast<std::uint16_t>(0x1400 + offset);
    const auto mapping = static_cast<std::uint16_t>(0x1600 + offset);

    std::vector<ObjectRef> objects;
    std::int64_t transmission = 255;
    std::int64_t event_timer = 0;
    if (number == 1) {
      const AxisObjects& axis = out_.axes.front();
      objects = {dictionary().entry(transmit ? axis.statusword : axis.controlword).ref};
    }
    for (const PdoConfig& pdo : config_.pdos) {
      if (pdo.node != node_ || pdo.transmit != transmit || pdo.number != number || !pdo.preset) {
        continue;
      }
      objects = pdo.objects;
      transmission = pdo.transmission;
      event_timer = pdo.event_timer_ms;
    }
    constexpr std::int64_t kOff = 0x8000'0000;
    parameter(communication, 1, 4,
              canopen::pdo_id(transmit, number, node_) | (objects.empty() ? kOff : 0));
    parameter(communication, 2, 1, transmission);
    if (transmit) parameter(communication, 3, 2, 0);
    parameter(communication, 5, 2, event_timer);
    parameter(mapping, 0, 1, static_cast<std::int64_t>(objects.size()));
    for (std::uint8_t i = 0; i < 8; ++i) {
      const ObjectRef ref = i < objects.size() ? objects[i] : ObjectRef{};
      parameter(mapping, static_cast<std::uint8_t>(i + 1), 4,
                static_cast<std::int64_t>(ref.index) << 16 | ref.sub << 8 | ref.bytes << 3);
    }
  }

  const Cia402Config& config_;
  std::uint8_t node_;
  DriveObjects out_;
};

}  // namespace

DriveObjects make_drive_objects(const Cia402Config& config, std::uint8_t node) {
  return Builder(config, node).build();
}

}  // namespace tether
