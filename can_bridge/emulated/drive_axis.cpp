#include "can_bridge/emulated/drive_axis.hpp"

#include <algorithm>
#include <cmath>

namespace tether {

void EmulatedDriveAxis::run(const ObjectDictionary& dictionary, Duration dt) {
  using Handle = ObjectDictionary::Handle;
  const auto real = [&](Handle h) { return static_cast<double>(dictionary.value(h)); };
  const auto option = [&](Handle h, int otherwise) {
    return h == ObjectDictionary::kNone ? otherwise : static_cast<int>(dictionary.value(h));
  };
  EmulatedAxis::Settings s;
  s.mode = static_cast<int>(dictionary.value(objects.mode));
  s.target = real(objects.target_velocity);
  s.acceleration = real(objects.acceleration);
  s.deceleration = real(objects.deceleration);
  s.quick_stop_deceleration = real(objects.quick_stop_deceleration);
  s.max_speed = real(objects.max_speed);
  // Wheels slower than this stand: a tenth of a radian a second, but at least half the drive's
  // unit.
  s.window = std::max(0.1 * objects.target_per_radps, 0.5);
  s.quick_stop_option = option(objects.quick_stop_option, 2);
  s.fault_reaction_option = option(objects.fault_option, 2);
  s.friction = coasting_radps2 * objects.target_per_radps;
  s.push = push_radps2 * objects.target_per_radps * objects.sign;
  s.brake_share = brake_share;
  s.actual = actual(objects.target_per_radps);
  machine.tick(s, dt);
}

void EmulatedDriveAxis::coast(Duration dt) {
  machine.coast(coasting_radps2 * objects.target_per_radps,
                push_radps2 * objects.target_per_radps * objects.sign, dt);
}

void EmulatedDriveAxis::show(ObjectDictionary& dictionary, std::uint16_t device_error) const {
  const auto put_half = [&dictionary](ObjectDictionary::Handle h, int shift, std::uint16_t word) {
    const std::int64_t others = dictionary.value(h) & ~(std::int64_t{0xFFFF} << shift);
    dictionary.store(h, others | static_cast<std::int64_t>(word) << shift);
  };
  const std::uint16_t error = machine.error_code() != 0 ? machine.error_code() : device_error;
  put_half(objects.statusword, objects.statusword_shift, machine.statusword());
  put_half(objects.error_code, objects.error_code_shift, error);
  dictionary.store(objects.mode_display, dictionary.value(objects.mode));
  dictionary.store(objects.actual_velocity, std::llround(actual(objects.actual_per_radps)));
  dictionary.store(objects.actual_position, objects.sign * encoder.counts(objects.counts_per_rad));
}

}  // namespace tether
