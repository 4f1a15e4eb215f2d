#include "sim/sensor/sensor_settings.hpp"

#include <fmt/format.h>

#include "common/base/errors.hpp"
#include "common/scenario/key_table.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {
namespace {

using Sensor = SensorSettings;

void check_sensor(const Scenario& scenario, const std::string& file) {
  const auto& sensor = scenario.get<SensorSettings>();
  const double rate_hz = sensor.rate_hz;
  if (sensor.send == Sensor::Send::changed && sensor.send_max_age_s * rate_hz < 1.0) {
    throw UsageError(
        fmt::format("{}: sensor.send_max_age_s = {} is below the time between two poses, {} s "
                    "(sensor.rate_hz = {}): all would be sent",
                    file, sensor.send_max_age_s, 1.0 / rate_hz, rate_hz));
  }
  const WorldSettings& world = scenario.get<WorldSettings>();
  if (from_seconds(1.0 / rate_hz) >= step_of(world)) return;
  throw UsageError(
      fmt::format("{}: sensor.rate_hz = {} asks for more than one pose a step: world.step_ms = {}",
                  file, rate_hz, world.step_ms));
}

constexpr Range kBias{-1e4, 1e4, false};
constexpr Range kPerMinute{0.0, 6000.0, false};

void add_noise(KeyTable<Sensor>& t) {
  t.number("position_noise_m", &Sensor::position_noise_m, kNotNegative,
           "standard deviation of noise on x and y");
  t.number("yaw_noise_rad", &Sensor::yaw_noise_rad, kNotNegative,
           "standard deviation of noise on yaw");
  t.number("noise_correlation_s", &Sensor::noise_correlation_s, kNotNegative,
           "correlation time of both noises (first-order Gauss-Markov); 0 = white");
  t.number("bias_x_m", &Sensor::bias_x_m, kBias, "constant error of x");
  t.number("bias_y_m", &Sensor::bias_y_m, kBias, "constant error of y");
  t.number("bias_yaw_rad", &Sensor::bias_yaw_rad, {-100.0, 100.0, false}, "constant error of yaw");
  t.number("position_drift_mpsqrts", &Sensor::position_drift_mpsqrts, kNotNegative,
           "random walk on x and y: standard deviation after 1 s");
  t.number("yaw_drift_radpsqrts", &Sensor::yaw_drift_radpsqrts, kNotNegative,
           "random walk on yaw: standard deviation after 1 s");
}

void add_events(KeyTable<Sensor>& t) {
  t.number("jumps_per_min", &Sensor::jumps_per_min, kPerMinute,
           "localisation jumps, at random times (Poisson)");
  t.number("jump_m", &Sensor::jump_m, kNotNegative, "standard deviation of a jump in x and y");
  t.number("jump_rad", &Sensor::jump_rad, kNotNegative, "standard deviation of a jump in yaw");
  t.number("jump_s", &Sensor::jump_s, kNotNegative, "duration of a jump; 0 = until the next");
  t.number("dropouts_per_min", &Sensor::dropouts_per_min, kPerMinute,
           "times without any pose, beginning at random while there are poses (Poisson)");
  t.number("dropout_s", &Sensor::dropout_s, kPositive, "their mean duration (exponential)");
}

void add_sending(KeyTable<Sensor>& t) {
  t.choice<Sensor::Send>("send", &Sensor::send,
                         {{"always", Sensor::Send::always}, {"changed", Sensor::Send::changed}},
                         "poses to send: all, or those that differ from the last one sent");
  t.number("send_delta_m", &Sensor::send_delta_m, kNotNegative,
           "send = changed: a pose farther than this from the last one sent is sent");
  t.number("send_delta_rad", &Sensor::send_delta_rad, kNotNegative,
           "send = changed: a pose with a yaw farther than this from the last one sent is sent");
  t.number("send_max_age_s", &Sensor::send_max_age_s, kPositive,
           "send = changed: the longest time between two poses that are sent");
}

std::vector<SwitchedKey> switched_keys() {
  const std::string jumps = "sensor.jumps_per_min";
  const std::string send = "sensor.send", always = "always";
  return {{"sensor.jump_m", {jumps}},
          {"sensor.jump_rad", {jumps}},
          {"sensor.jump_s", {jumps}},
          {"sensor.dropout_s", {"sensor.dropouts_per_min"}},
          {"sensor.encoder_ticks", {"sensor.odometry_rate_hz"}},
          {"sensor.send_delta_m", {send}, always},
          {"sensor.send_delta_rad", {send}, always},
          {"sensor.send_max_age_s", {send}, always},
          {"sensor.noise_correlation_s", {"sensor.position_noise_m", "sensor.yaw_noise_rad"}}};
}

}  // namespace

ScenarioSection sensor_section() {
  KeyTable<Sensor> t("sensor.");
  t.number("rate_hz", &Sensor::rate_hz, kRate, "poses per second");
  add_noise(t);
  add_events(t);
  t.number("latency_ms", &Sensor::latency_ms, {0.0, 1e6, false},
           "time from measurement to publication");
  add_sending(t);
  t.number("odometry_rate_hz", &Sensor::odometry_rate_hz, {0.0, 1000.0, false},
           "the wheels' odometry, sent to the controller, per second; 0 = none");
  t.whole_number("encoder_ticks", &Sensor::encoder_ticks, 0,
                 "encoder ticks per wheel revolution, for the odometry; 0 = exact");
  ScenarioSection section{.defaults = Sensor{}, .keys = t.take()};
  section.switched = switched_keys();
  section.left_out = [](const Scenario& scenario, const ScenarioKey& key) {
    return key.name == "sensor.send" && scenario.get<Sensor>().send == Sensor::Send::always;
  };
  section.check = check_sensor;
  return section;
}

}  // namespace tether
