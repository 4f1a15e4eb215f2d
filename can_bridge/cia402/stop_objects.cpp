#include "can_bridge/cia402/stop_objects.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <numbers>

#include "can_bridge/bus/canopen.hpp"

namespace tether::cia402 {
namespace {

constexpr std::uint16_t kFirstOfProfile = 0x6000, kLastOfProfile = 0x9FFF, kAxisStep = 0x800;
constexpr std::uint16_t kTargetVelocity = 0x60FF;
constexpr std::uint16_t kQuickStopOption = 0x605A, kProfileDeceleration = 0x6084,
                        kQuickStopDeceleration = 0x6085;

/// The standard's object `base` for axis `i`, as the file writes it: beside the axis' target
/// velocity, at its subindex or at 0.
std::optional<std::int64_t> written(const Cia402Config& config, std::size_t i, std::uint16_t base) {
  const AxisConfig& axis = config.axes[i];
  const int offset = axis.target_velocity.index - kTargetVelocity;
  const bool standard = offset >= 0 && offset % kAxisStep == 0;
  const int index = base + (standard ? offset : 0);
  for (const std::uint8_t sub : {axis.target_velocity.sub, std::uint8_t{0}}) {
    for (const SetupWrite& write : config.setup) {
      if (write.node != axis.node || write.object.index != index || write.object.sub != sub) {
        continue;
      }
      return write.value;
    }
  }
  return std::nullopt;
}

}  // namespace

std::optional<std::int64_t> quick_stop_option(const Cia402Config& config, std::size_t i) {
  return written(config, i, kQuickStopOption);
}

double stop_ramp_radps2(const Cia402Config& config, std::size_t i) {
  const std::int64_t option = quick_stop_option(config, i).value_or(2);
  const bool profile_ramp = config.stops_by_setpoint || option == 1 || option == 5;
  const auto units =
      written(config, i, profile_ramp ? kProfileDeceleration : kQuickStopDeceleration);
  if (!units) return std::numeric_limits<double>::infinity();
  return static_cast<double>(*units) / config.axes[i].target_velocity_per_rps.value() * 2.0 *
         std::numbers::pi;
}

StopPart stop_part(std::uint16_t index) {
  if (canopen::is_pdo_parameter(index)) return StopPart::pdo;
  if (index == 0x1016) return StopPart::other;
  if (index < kFirstOfProfile || index > kLastOfProfile) return StopPart::none;
  const auto base =
      static_cast<std::uint16_t>(kFirstOfProfile + (index - kFirstOfProfile) % kAxisStep);
  if (base == kQuickStopDeceleration || (base >= kQuickStopOption && base <= 0x605E)) {
    return StopPart::quick_stop;
  }
  // Abort connection option, profile deceleration, polarity, encoder resolution, feed, gear.
  constexpr std::array<std::uint16_t, 8> kOthers{
      0x6007, kProfileDeceleration, 0x607E, 0x608F, 0x6090, 0x6091, 0x6092, 0x6096};
  return std::ranges::find(kOthers, base) != kOthers.end() ? StopPart::other : StopPart::none;
}

}  // namespace tether::cia402
