#pragma once

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/cia402/config.hpp"

namespace tether::test {

/// A scripted CANopen node with CiA 402 axes: an object dictionary, PDOs as that maps them, the
/// state machine, and speeds that move by `ramp` units a cycle; not operational, it brakes. RPDOs
/// act at SYNC, SDO at once. What goes wrong is said by its public members.
class FakeDrive {
 public:
  using Key = std::pair<std::uint16_t, std::uint8_t>;

  struct Axis {
    AxisConfig objects;
    canopen::DriveState state = canopen::DriveState::switch_on_disabled;
    std::int64_t speed = 0;     // units of actual_velocity
    std::int64_t position = 0;  // counts; moves by `speed` a cycle
    std::int64_t ramp = 10;     // speed units a cycle
    int quick_stop_option = 6;  // 2: SwitchOnDisabled after the ramp; 6: stays in QuickStopActive
    std::uint16_t error = 0;
    std::optional<canopen::DriveState> stuck_below;  // goes no further than this
    std::uint16_t last_control = 0;
  };

  FakeDrive(const Cia402Config& config, std::uint8_t node) : node_(node) {
    for (const AxisConfig& axis : config.axes) {
      if (axis.node != node) continue;
      axes.emplace_back();
      axes.back().objects = axis;
    }
    for (const SetupWrite& s : config.setup) {
      if (s.node == node) sizes_[key(s.object)] = s.object.bytes;
    }
    for (const WatchdogConfig& w : config.watchdogs) {
      if (w.node == node) sizes_[key(w.object)] = w.object.bytes;
    }
    forget();
  }

  // --- what goes wrong
  bool silent = false;                  // sends nothing
  bool send_feedback = true;            // TPDOs
  bool beat = true;                     // heartbeats
  bool boots = true;                    // answers NMT reset
  bool runs_on = false;                 // does not brake because it is not operational
  std::map<Key, std::uint32_t> aborts;  // all access to these objects
  std::map<Key, std::int64_t> clamps;   // these keep this value, whatever is written
  std::optional<Key> unanswered, segmented, wrong_index;
  int lost_replies = 0;          // so many SDO replies are lost
  std::set<Key> insisted_bits;   // objects that keep bit 30, and abort writes without it
  bool shows_mode_late = false;  // 0x6061 is 0 unless enabled
  std::optional<std::int64_t> enabled_mode;    // 0x6061 while enabled
  std::optional<std::int64_t> speed_reads;     // 0x606C, whatever the wheel does
  std::optional<std::int64_t> position_reads;  // 0x6064, in the same way

  std::vector<Axis> axes;
  canopen::NmtState nmt = canopen::NmtState::operational;
  int resets = 0;
  std::int64_t fastest_reset = 0;  // speed of the fastest wheel that was reset

  std::int64_t object(std::uint16_t index, std::uint8_t sub) const {
    const auto found = values_.find({index, sub});
    return found == values_.end() ? 0 : found->second;
  }
  void set_object(std::uint16_t index, std::uint8_t sub, std::int64_t value) {
    values_[{index, sub}] = value;
  }

  void on_frame(const CanFrame& f, std::vector<CanFrame>& out) {
    if (f.id == canopen::kNmt && (f.data[1] == node_ || f.data[1] == 0)) on_nmt(f.data[0], out);
    if (f.id == canopen::kSdoRequest + node_) on_sdo(f, out);
    if (nmt != canopen::NmtState::operational) return;
    for (std::uint8_t n = 0; n < 4; ++n) {
      const auto comm = static_cast<std::uint16_t>(0x1400 + n);
      if (object(comm, 1) == f.id) on_rpdo(static_cast<std::uint16_t>(0x1600 + n), f);
    }
  }

  /// One control cycle: at SYNC, or after the setpoints where there is none.
  void cycle(std::vector<CanFrame>& out) {
    for (const auto& [k, value] : received_) values_[k] = value;
    received_.clear();
    for (Axis& axis : axes) {
      nmt == canopen::NmtState::operational || runs_on ? run(axis) : brake(axis);
    }
    publish_objects();
    if (nmt != canopen::NmtState::operational || silent || !send_feedback) return;
    for (std::uint8_t n = 0; n < 4; ++n) {
      const auto comm = static_cast<std::uint16_t>(0x1800 + n);
      if (object(comm, 1) == 0 || (object(comm, 1) & 0x80000000) != 0) continue;
      out.push_back(tpdo(static_cast<std::uint16_t>(0x1A00 + n),
                         static_cast<std::uint32_t>(object(comm, 1) & 0x7FF)));
    }
  }

  /// A control cycle in which no SYNC came: it keeps its last setpoint, or brakes.
  void cycle_alone() {
    for (Axis& axis : axes) {
      nmt == canopen::NmtState::operational || runs_on ? run(axis) : brake(axis);
    }
    publish_objects();
  }

  void heartbeat(std::vector<CanFrame>& out) const {
    if (!silent && beat && object(0x1017, 0) > 0)
      out.push_back(canopen::heartbeat_frame(node_, nmt));
  }

  /// Power cycle.
  void reboot(std::vector<CanFrame>& out) {
    forget();
    nmt = canopen::NmtState::pre_operational;
    for (Axis& axis : axes) {
      axis.state = canopen::DriveState::switch_on_disabled;
      axis.speed = axis.position = 0;
      axis.error = 0;
      axis.last_control = 0;
    }
    if (!silent) out.push_back(canopen::heartbeat_frame(node_, canopen::NmtState::boot_up));
  }

  void trip(Axis& axis, std::uint16_t error) const {
    axis.state = canopen::DriveState::fault;
    axis.error = error;
    axis.speed = 0;
  }

 private:
  static constexpr std::int64_t kBit30 = 0x40000000;

  static Key key(const ObjectRef& o) { return {o.index, o.sub}; }

  void forget() {
    const std::int64_t type = object(0x1000, 0);
    values_.clear();
    values_[{0x1000, 0}] = type != 0 ? type : 0x00020192;
    publish_objects();
  }

  void on_nmt(std::uint8_t command, std::vector<CanFrame>& out) {
    if (command == 0x81) {
      ++resets;
      for (const Axis& axis : axes) fastest_reset = std::max(fastest_reset, std::abs(axis.speed));
      if (boots) reboot(out);
    } else if (command == 0x01) {
      nmt = canopen::NmtState::operational;
    } else if (command == 0x02) {
      nmt = canopen::NmtState::stopped;
    } else if (command == 0x80) {
      nmt = canopen::NmtState::pre_operational;
    }
  }

  void on_sdo(const CanFrame& f, std::vector<CanFrame>& out) {
    const Key k{static_cast<std::uint16_t>(f.data[1] | f.data[2] << 8), f.data[3]};
    const ObjectRef ref{k.first, k.second, 4, false};
    const std::uint32_t id = canopen::kSdoResponse + node_;
    if (silent || f.data[0] == 0x80 || unanswered == k) return;
    if (nmt == canopen::NmtState::stopped) return;
    if (lost_replies > 0) {
      --lost_replies;
      return;
    }
    if (aborts.contains(k)) {
      out.push_back(canopen::sdo_abort(id, ref, aborts.at(k)));
      return;
    }
    CanFrame reply = canopen::sdo_abort(id, ref, 0);
    if (insisted_bits.contains(k)) {
      values_[k] |= kBit30;
      if (f.data[0] != 0x40 && (f.data[7] & 0x40) == 0) {
        out.push_back(canopen::sdo_abort(id, ref, 0x06090030));
        return;
      }
    }
    if (f.data[0] == 0x40) {
      const std::uint8_t bytes = sizes_.contains(k) ? sizes_.at(k) : 4;
      reply.data[0] = static_cast<std::uint8_t>(segmented == k ? 0x41 : 0x43 | (4 - bytes) << 2);
      canopen::write_integer(reply.data.data() + 4, 4,
                             clamps.contains(k) ? clamps.at(k) : values_[k]);
    } else {
      const auto bytes = static_cast<std::uint8_t>(4 - (f.data[0] >> 2 & 3));
      sizes_[k] = bytes;
      values_[k] = canopen::read_integer(f.data.data() + 4, bytes, false);
      reply.data[0] = 0x60;
    }
    if (wrong_index == k) ++reply.data[1];
    publish_objects();
    out.push_back(reply);
  }

  void on_rpdo(std::uint16_t mapping, const CanFrame& f) {
    std::size_t at = 0;
    for (int i = 1; i <= object(mapping, 0); ++i) {
      const std::int64_t entry = object(mapping, static_cast<std::uint8_t>(i));
      const auto bytes = static_cast<std::uint8_t>((entry & 0xFF) / 8);
      received_[{static_cast<std::uint16_t>(entry >> 16),
                 static_cast<std::uint8_t>(entry >> 8 & 0xFF)}] =
          canopen::read_integer(f.data.data() + at, bytes, true);
      at += bytes;
    }
  }

  CanFrame tpdo(std::uint16_t mapping, std::uint32_t id) const {
    CanFrame f;
    f.id = id;
    for (int i = 1; i <= object(mapping, 0); ++i) {
      const std::int64_t entry = object(mapping, static_cast<std::uint8_t>(i));
      const auto bytes = static_cast<std::uint8_t>((entry & 0xFF) / 8);
      canopen::write_integer(f.data.data() + f.size, bytes,
                             object(static_cast<std::uint16_t>(entry >> 16),
                                    static_cast<std::uint8_t>(entry >> 8 & 0xFF)));
      f.size = static_cast<std::uint8_t>(f.size + bytes);
    }
    return f;
  }

  void run(Axis& axis) {
    using canopen::DriveState;
    const auto control = static_cast<std::uint16_t>(
        object(axis.objects.controlword.index, axis.objects.controlword.sub) & 0xFFFF);
    const bool reset_edge = (control & 0x80) != 0 && (axis.last_control & 0x80) == 0;
    axis.last_control = control;
    DriveState& s = axis.state;
    const DriveState before = s;
    const bool voltage = (control & 2) != 0, no_quick_stop = (control & 4) != 0;
    if (s == DriveState::fault_reaction) {
      s = DriveState::fault;
    } else if (s == DriveState::fault) {
      if (reset_edge && axis.error != 0xFFFF) {
        s = DriveState::switch_on_disabled;
        axis.error = 0;
      }
    } else if (!voltage) {
      s = DriveState::switch_on_disabled;
    } else if (!no_quick_stop) {
      if (s == DriveState::operation_enabled)
        s = DriveState::quick_stop_active;
      else if (s != DriveState::quick_stop_active)
        s = DriveState::switch_on_disabled;
    } else if ((control & 0x0F) == 6 && s != DriveState::quick_stop_active) {
      s = DriveState::ready_to_switch_on;
    } else if ((control & 0x0F) == 7 && s == DriveState::ready_to_switch_on) {
      s = DriveState::switched_on;
    } else if ((control & 0x0F) == 0x0F && s == DriveState::switched_on) {
      s = DriveState::operation_enabled;
    }
    if (axis.stuck_below && s > before && s > *axis.stuck_below &&
        s <= DriveState::operation_enabled)
      s = before;
    move(axis);
  }

  /// Without master: quick stop.
  static void brake(Axis& axis) {
    using canopen::DriveState;
    if (axis.state == DriveState::operation_enabled) axis.state = DriveState::quick_stop_active;
    axis.speed += std::clamp(-axis.speed, -axis.ramp, axis.ramp);
    axis.position += axis.speed;
    if (axis.state == DriveState::quick_stop_active && axis.speed == 0) {
      axis.state = DriveState::switch_on_disabled;
    }
  }

  void move(Axis& axis) const {
    using canopen::DriveState;
    std::int64_t target = 0;
    if (axis.state == DriveState::operation_enabled) {
      // Same unit of target and actual velocity, up to their ratios.
      const Ratio& t = axis.objects.target_velocity_per_rps;
      const Ratio& a = axis.objects.actual_velocity_per_rps;
      target = object(axis.objects.target_velocity.index, axis.objects.target_velocity.sub) *
               (a.num * t.den) / (a.den * t.num);
    }
    axis.speed += std::clamp(target - axis.speed, -axis.ramp, axis.ramp);
    axis.position += axis.speed;
    if (axis.state == DriveState::quick_stop_active && axis.speed == 0 &&
        axis.quick_stop_option == 2) {
      axis.state = DriveState::switch_on_disabled;
    }
  }

  void publish_objects() {
    std::set<Key> cleared;
    for (const Axis& axis : axes) {
      const AxisConfig& o = axis.objects;
      if (cleared.insert(key(o.statusword)).second) values_[key(o.statusword)] = 0;
      values_[key(o.statusword)] |= std::int64_t{statusword(axis.state)} << o.statusword_shift;
      values_[key(o.actual_velocity)] = speed_reads.value_or(axis.speed);
      values_[key(o.actual_position)] = position_reads.value_or(axis.position);
      values_[key(o.error_code)] = axis.error;
      values_[key(o.mode_display)] = shown_mode(axis);
    }
  }

  std::int64_t shown_mode(const Axis& axis) const {
    const bool enabled = axis.state == canopen::DriveState::operation_enabled;
    if (enabled && enabled_mode) return *enabled_mode;
    if (shows_mode_late && !enabled) return 0;
    return object(axis.objects.mode.index, axis.objects.mode.sub);
  }

  static std::uint16_t statusword(canopen::DriveState state) {
    static constexpr std::uint16_t kWords[]{0x0200, 0x0250, 0x0231, 0x0233,
                                            0x0237, 0x0217, 0x021F, 0x0218};
    return kWords[static_cast<int>(state)];
  }

  std::uint8_t node_;
  std::map<Key, std::int64_t> values_;
  std::map<Key, std::int64_t> received_;  // by RPDO, until the next SYNC
  std::map<Key, std::uint8_t> sizes_{{{0x1017, 0}, 2}, {{0x6061, 0}, 1}};
};

}  // namespace tether::test
