#include "can_bridge/cia402/pdo.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/cia402/config.hpp"
#include "can_bridge/cia402/startup.hpp"
#include "common/base/errors.hpp"

namespace tether::cia402 {
namespace {

struct Role {
  Signal signal;
  const ObjectRef& object;
};

std::vector<Role> roles(const AxisConfig& axis, bool transmit) {
  if (transmit) {
    return {{Signal::statusword, axis.statusword},
            {Signal::actual_velocity, axis.actual_velocity},
            {Signal::actual_position, axis.actual_position},
            {Signal::mode_display, axis.mode_display},
            {Signal::error_code, axis.error_code}};
  }
  return {{Signal::controlword, axis.controlword},
          {Signal::target_velocity, axis.target_velocity},
          {Signal::mode, axis.mode}};
}

/// CiA 301, 7.4.7.1: data types as mapping dummies, which a drive ignores.
bool is_dummy(const ObjectRef& object) { return object.index >= 1 && object.index <= 7; }

PdoMap::Pdo layout(const Cia402Config& config, const PdoConfig& pdo) {
  const std::string name = fmt::format("{} of node {}", pdo_name(pdo), pdo.node);
  PdoMap::Pdo result;
  result.id = canopen::pdo_id(pdo.transmit, pdo.number, pdo.node);
  result.node = pdo.node;
  result.number = pdo.number;
  for (const ObjectRef& object : pdo.objects) {
    bool known = pdo.transmit || is_dummy(object);
    for (std::size_t axis = 0; axis < config.axes.size(); ++axis) {
      if (config.axes[axis].node != pdo.node) continue;
      for (const Role& role : roles(config.axes[axis], pdo.transmit)) {
        if (!same_object(role.object, object)) continue;
        if (role.object.bytes != object.bytes) {
          throw UsageError(fmt::format("{}: {} maps {} with {} bytes, but the {} has it with {}",
                                       config.name, name, object_text(object), object.bytes,
                                       axis_name(config, axis), role.object.bytes));
        }
        result.fields.push_back({role.signal, axis, role.object, result.size});
        known = true;
      }
    }
    if (!known) {
      throw UsageError(fmt::format("{}: {} maps {}, which commands no axis", config.name, name,
                                   object_text(object)));
    }
    if (result.size + object.bytes > 8) {
      throw UsageError(fmt::format("{}: {} maps more than 8 bytes", config.name, name));
    }
    result.size = static_cast<std::uint8_t>(result.size + object.bytes);
  }
  return result;
}

bool carries(const std::vector<PdoMap::Pdo>& pdos, Signal signal, std::size_t axis) {
  return std::ranges::any_of(pdos, [&](const PdoMap::Pdo& pdo) {
    return std::ranges::any_of(pdo.fields, [&](const PdoMap::Field& field) {
      return field.signal == signal && field.axis == axis;
    });
  });
}

}  // namespace

PdoMap::PdoMap(const Cia402Config& config) {
  for (const PdoConfig& pdo : config.pdos) {
    (pdo.transmit ? tpdos_ : rpdos_).push_back(layout(config, pdo));
  }
  for (std::size_t i = 0; i < config.axes.size(); ++i) {
    const auto need = [&](bool transmit, Signal signal, const ObjectRef& object,
                          const char* meaning) {
      if (carries(transmit ? tpdos_ : rpdos_, signal, i)) return;
      throw UsageError(fmt::format("{}: no {} carries the {}'s {}", config.name,
                                   transmit ? "TPDO" : "RPDO", axis_name(config, i),
                                   object_text(object, meaning)));
    };
    const AxisConfig& axis = config.axes[i];
    need(false, Signal::controlword, axis.controlword, "controlword");
    need(false, Signal::target_velocity, axis.target_velocity, "target velocity");
    need(true, Signal::statusword, axis.statusword, "statusword");
    need(true, Signal::actual_velocity, axis.actual_velocity, "actual velocity");
    need(true, Signal::actual_position, axis.actual_position, "actual position");
  }
}

void PdoMap::pack(const std::array<Setpoint, 2>& setpoints, std::vector<CanFrame>& out) const {
  for (const Pdo& pdo : rpdos_) {
    CanFrame frame;
    frame.id = pdo.id;
    frame.size = pdo.size;
    for (const Field& field : pdo.fields) {
      const Setpoint& setpoint = setpoints[field.axis];
      std::int64_t value = kProfileVelocity;
      if (field.signal == Signal::controlword) value = setpoint.controlword;
      if (field.signal == Signal::target_velocity) value = setpoint.target_velocity;
      canopen::write_integer(frame.data.data() + field.offset, field.object.bytes, value);
    }
    out.push_back(frame);
  }
}

const PdoMap::Pdo* PdoMap::tpdo(std::uint32_t id) const {
  const auto found = std::ranges::find(tpdos_, id, &Pdo::id);
  return found == tpdos_.end() ? nullptr : &*found;
}

bool PdoMap::unpack(const Pdo& pdo, const CanFrame& frame,
                    const std::function<void(const Field&, std::int64_t)>& value) {
  if (frame.size != pdo.size) return false;
  for (const Field& field : pdo.fields) {
    value(field, canopen::read_integer(frame.data.data() + field.offset, field.object.bytes,
                                       field.object.is_signed));
  }
  return true;
}

}  // namespace tether::cia402
