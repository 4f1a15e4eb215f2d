#include "sim/sensor/sensor_settings.hpp"

#include "common/scenario/key_table.hpp"

namespace tether {

ScenarioSection sensor_section() {
  using Sensor = SensorSettings;
  KeyTable<Sensor> t("sensor.");
  t.number("rate_hz", &Sensor::rate_hz, kRate, "poses per second");
  t.number("position_noise_m", &Sensor::position_noise_m, kNotNegative,
           "standard deviation of white noise on x and y");
  t.number("yaw_noise_rad", &Sensor::yaw_noise_rad, kNotNegative,
           "standard deviation of white noise on yaw");
  t.number("position_drift_mpsqrts", &Sensor::position_drift_mpsqrts, kNotNegative,
           "random walk on x and y: standard deviation after 1 s");
  t.number("yaw_drift_radpsqrts", &Sensor::yaw_drift_radpsqrts, kNotNegative,
           "random walk on yaw: standard deviation after 1 s");
  t.number("latency_ms", &Sensor::latency_ms, {0.0, 1e6, false}, "from measurement to publication");
  return {.defaults = Sensor{}, .keys = t.take()};
}

}  // namespace tether
