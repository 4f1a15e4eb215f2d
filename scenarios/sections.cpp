#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "can_bridge/drivetrain/can_settings.hpp"
#include "common/base/errors.hpp"
#include "common/fleet/fleet.hpp"
#include "common/fleet/own_keys.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/scenario/section.hpp"
#include "common/vehicle/actuator_policy.hpp"
#include "common/vehicle/actuator_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/onboard_settings.hpp"
#include "common/world/stopping_field.hpp"
#include "common/world/surroundings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "controller/laws/law.hpp"
#include "controller/tube/reach_tube.hpp"
#include "doors/ros2/ros2_settings.hpp"
#include "netem/channel/settings.hpp"
#include "netem/medium/medium_settings.hpp"
#include "netem/models/kinds.hpp"
#include "onboard/autonomy/autonomy_section.hpp"
#include "onboard/localiser/localiser_section.hpp"
#include "scenarios/radio_traffic.hpp"
#include "sim/sensor/lidar_settings.hpp"
#include "sim/sensor/sensor_settings.hpp"

namespace tether {
namespace {

/// From a pose's measurement to its arrival, as far as it is known before: jitter and [medium] are
/// not.
double pose_delay_s(const Scenario& scenario) {
  const LinkConfig& link = scenario.get<ChannelSettings>().uplink;
  const ChannelModelKind& kind = kind_of(link);
  const auto channel_ms = kind.only_delay_ms != nullptr ? kind.only_delay_ms(link) : std::nullopt;
  return 1e-3 * (scenario.get<SensorSettings>().latency_ms + channel_ms.value_or(0.0));
}

/// Checks both senders, so that a receiver does not take a message for lost that was not sent.
void check_sending(const Scenario& scenario, const std::string& file) {
  const auto& sensor = scenario.get<SensorSettings>();
  const auto& controller = scenario.get<ControllerSettings>();
  const bool poses = sends_changes(sensor), commands = sends_changes(controller);
  if (!poses && !commands) return;
  const std::string given =
      fmt::format("{}: {}.send = \"changed\"", file, poses ? "sensor" : "controller");
  if (scenario.get<AutonomySettings>().enabled) {
    throw UsageError(given +
                     " needs autonomy.enabled = false: a vehicle that drives by itself "
                     "takes all poses, and commands that mean its present request");
  }
  if (poses && scenario.get<LocaliserSettings>().place != LocaliserSettings::Place::none) {
    throw UsageError(given + " needs localiser.place = \"none\": else the sensor makes no poses");
  }
  if (scenario.get<MediumSettings>().others > 0) {
    throw UsageError(given +
                     " needs medium.others = 0: others send in equal periods; vehicles "
                     "that send as this one does are fleet.count");
  }
  const double delay_s = pose_delay_s(scenario);
  if (poses && controller.pose_timeout_s > 0.0 &&
      sensor.send_max_age_s + delay_s >= controller.pose_timeout_s) {
    throw UsageError(fmt::format(
        "{}: sensor.send_max_age_s = {}{} must be below controller.pose_timeout_s = {}, or the "
        "controller would stop a vehicle that sends nothing new",
        file, sensor.send_max_age_s,
        delay_s > 0.0 ? fmt::format(" and the {:g} s that a pose takes (sensor.latency_ms and the "
                                    "uplink's delay)",
                                    delay_s)
                      : "",
        controller.pose_timeout_s));
  }
  if (!commands || !kind_of(controller).sends_plans) return;
  if (controller.send_max_age_s >= controller.horizon_s) {
    throw UsageError(fmt::format(
        "{}: controller.send_max_age_s = {} must be below controller.horizon_s = {}: a plan would "
        "end before the next is sent",
        file, controller.send_max_age_s, controller.horizon_s));
  }
}

/// The same for commands of which not all are sent.
void check_timeout_of_changes(const Scenario& scenario, const std::string& file) {
  const auto& sensor = scenario.get<SensorSettings>();
  const auto& controller = scenario.get<ControllerSettings>();
  const bool by_timer = controller.trigger == ControllerSettings::Trigger::timer;
  // With trigger = event, a command that is due waits for the next pose.
  const double poses_s = sends_changes(sensor) ? sensor.send_max_age_s : 1.0 / sensor.rate_hz;
  const double most_s = (sends_changes(controller) ? controller.send_max_age_s
                         : by_timer                ? 1.0 / controller.rate_hz
                                                   : 0.0) +
                        (by_timer ? 0.0 : poses_s);
  const double timeout_s = scenario.get<ActuatorSettings>().timeout_s;
  if (most_s < timeout_s) return;
  throw UsageError(fmt::format(
      "{}: actuator.timeout_s = {} must be above the longest time between two commands, {:g} s "
      "(controller.send_max_age_s and, with controller.trigger = \"event\", the time between two "
      "poses, sensor.send_max_age_s or 1 / sensor.rate_hz): the vehicle would stop in between",
      file, timeout_s, most_s));
}

/// The bridge takes a silence for a controller that is gone.
void check_bridge_of_changes(const Scenario& scenario, const std::string& file) {
  const auto& controller = scenario.get<ControllerSettings>();
  const bool by_can =
      scenario.get<VehicleSettings>().drivetrain == VehicleSettings::Drivetrain::can;
  if (!by_can || !sends_changes(controller)) return;
  const auto& can = scenario.get<CanSettings>();
  const bool plans = kind_of(controller).sends_plans;
  const double most_s = plans ? can.max_blind_s : 1e-3 * can.stale_ms;
  if (controller.send_max_age_s < most_s) return;
  throw UsageError(fmt::format(
      "{}: controller.send_max_age_s = {} must be below {:g} s ({} = {}): the bridge would stop "
      "the "
      "vehicle in between",
      file, controller.send_max_age_s, most_s, plans ? "can.max_blind_s" : "can.stale_ms",
      plans ? can.max_blind_s : can.stale_ms));
}

/// A vehicle that stops between two commands was not meant: the timeout is longer than the period.
void check_timeout(const Scenario& scenario, const std::string& file) {
  const auto& actuator = scenario.get<ActuatorSettings>();
  const auto& controller = scenario.get<ControllerSettings>();
  const ActuatorPolicy& policy = kind_of(actuator);
  check_sending(scenario, file);
  check_bridge_of_changes(scenario, file);
  const bool changes = sends_changes(scenario.get<SensorSettings>()) || sends_changes(controller);
  // Plans have an end of their own; twists have the timeout, whatever the policy takes.
  const bool has_timeout = !policy.takes_plans || (changes && !kind_of(controller).sends_plans);
  if (policy.after_timeout == nullptr || !has_timeout) return;
  if (changes) return check_timeout_of_changes(scenario, file);
  const bool by_timer = controller.trigger == ControllerSettings::Trigger::timer;
  const double rate_hz = by_timer ? controller.rate_hz : scenario.get<SensorSettings>().rate_hz;
  if (actuator.timeout_s * rate_hz >= 1.0) return;
  throw UsageError(fmt::format(
      "{}: actuator.timeout_s = {} is below the time between two commands, {} s ({} = {}): the "
      "vehicle would stop before each of them",
      file, actuator.timeout_s, 1.0 / rate_hz, by_timer ? "controller.rate_hz" : "sensor.rate_hz",
      rate_hz));
}

/// All of the way ahead, of the vehicle's width and up to `field_m`, has to be in the scanner's
/// view: what the vehicle itself hides would count as free.
void check_view_ahead(const Scenario& scenario, const std::string& file, double field_m) {
  const auto& lidar = scenario.get<LidarSettings>();
  const auto& vehicle = scenario.get<VehicleSettings>();
  const Pose2 mount = lidar.mount(vehicle);
  const std::vector<bool> hidden = hidden_beams(lidar, vehicle);
  const auto sees = [&](double x_m, double y_m) {
    const double direction_rad = std::atan2(y_m - mount.y_m, x_m - mount.x_m);
    const double angle_rad = wrap_angle(direction_rad - mount.yaw_rad) - lidar.angle_min_rad();
    const double beam = std::round(angle_rad / std::max(lidar.angle_increment_rad(), 1e-9));
    return beam >= 0.0 && beam < static_cast<double>(hidden.size()) &&
           !hidden[static_cast<std::size_t>(beam)];
  };
  constexpr double kStep_m = 0.1;
  const double front_m = 0.5 * vehicle.chassis_length_m - vehicle.axle_x_m;
  const double half_m = 0.5 * vehicle.chassis_width_m;
  for (double x_m = front_m + kStep_m; x_m < front_m + field_m + kStep_m; x_m += kStep_m) {
    for (const double y_m : {-half_m, 0.0, half_m}) {
      if (sees(x_m, y_m)) continue;
      throw UsageError(fmt::format(
          "{}: the scanner at lidar.mount_x_m = {}, mount_y_m = {}, mount_yaw_rad = {} does not "
          "see "
          "the way ahead, for example ({:.2f}, {:.2f}) m from the axle: with autonomy.enabled put "
          "it at "
          "the front, at x = {:g} m, or above the chassis, and lidar.fov_rad = {:g} wide enough",
          file, mount.x_m, mount.y_m, mount.yaw_rad, x_m, y_m, front_m, lidar.fov_rad));
    }
  }
}

/// Checks autonomy's needs on other rooms' sections.
void check_autonomy(const Scenario& scenario, const std::string& file) {
  const auto& autonomy = scenario.get<AutonomySettings>();
  if (!autonomy.enabled) return;
  if (scenario.get<SensorSettings>().odometry_rate_hz == 0.0) {
    throw UsageError(
        fmt::format("{}: autonomy.enabled needs odometry: sensor.odometry_rate_hz > 0", file));
  }
  if (scenario.get<LocaliserSettings>().place == LocaliserSettings::Place::edge) {
    throw UsageError(fmt::format(
        "{}: autonomy.enabled needs poses on the vehicle: localiser.place = \"none\" or "
        "\"vehicle\"",
        file));
  }
  const auto& lidar = scenario.get<LidarSettings>();
  if (!lidar.on()) {
    throw UsageError(
        fmt::format("{}: autonomy.enabled needs a scanner: lidar.model other than \"none\"", file));
  }
  if (autonomy.reaction_s < 2.0 / lidar.rate_hz) {
    throw UsageError(
        fmt::format("{}: autonomy.reaction_s = {} is less than two turns of the scanner, {:g} s "
                    "(lidar.rate_hz = "
                    "{}): its scans would be too old",
                    file, autonomy.reaction_s, 2.0 / lidar.rate_hz, lidar.rate_hz));
  }
  const auto& vehicle = scenario.get<VehicleSettings>();
  const double speed_mps =
      std::min(vehicle.max_wheel_speed_mps, scenario.get<PathSettings>().limits.speed_mps);
  const double field_m = StoppingField(autonomy).length_m(speed_mps);
  const double apart_m = field_m * (lidar.beams > 1 ? lidar.angle_increment_rad() : lidar.fov_rad);
  if (apart_m > vehicle.chassis_width_m) {
    throw UsageError(fmt::format(
        "{}: lidar.beams = {}: at the end of the stopping field, {:.1f} m ahead, its beams are "
        "{:.1f} m apart, and what is as wide as the vehicle, {:.2f} m, could stand between them",
        file, lidar.beams, field_m, apart_m, vehicle.chassis_width_m));
  }
  check_view_ahead(scenario, file, field_m);
  const auto& can = scenario.get<CanSettings>();
  const bool by_can =
      scenario.get<VehicleSettings>().drivetrain == VehicleSettings::Drivetrain::can;
  if (by_can && can.max_deceleration_mps2 < autonomy.deceleration_mps2) {
    throw UsageError(fmt::format(
        "{}: can.max_deceleration_mps2 = {} brakes less than autonomy.deceleration_mps2 = {}: the "
        "vehicle would stop behind its stopping field's end",
        file, can.max_deceleration_mps2, autonomy.deceleration_mps2));
  }
}

/// The localiser cannot do without wheels and scanner.
void check_inputs(const Scenario& scenario, const std::string& file) {
  const auto& localiser = scenario.get<LocaliserSettings>();
  if (localiser.place == LocaliserSettings::Place::none) return;
  if (!localiser.knows_start && scenario.get<ControllerSettings>().preload) {
    throw UsageError(
        fmt::format("{}: controller.preload = true plans from the start, which is unknown with "
                    "localiser.knows_start = false: set one of them otherwise",
                    file));
  }
  if (scenario.get<SensorSettings>().odometry_rate_hz <= 0.0) {
    throw UsageError(fmt::format(
        "{}: localiser.place needs the wheels' odometry: sensor.odometry_rate_hz above 0, say 50",
        file));
  }
  if (!scenario.get<LidarSettings>().on()) {
    throw UsageError(
        fmt::format("{}: localiser.place needs a scanner: lidar.model = custom or one of {}; or "
                    "localiser.place = \"none\"",
                    file, fmt::join(lidar_presets(), ", ")));
  }
  if (const auto beams = scenario.get<LidarSettings>().beams;
      beams < LocaliserSettings::kLeastBeams) {
    throw UsageError(fmt::format(
        "{}: localiser.place needs a scanner of more beams: lidar.beams = {}, at least {}", file,
        beams, LocaliserSettings::kLeastBeams));
  }
  const double height_m = scenario.get<LocaliserSettings>().scan_height_m;
  const std::vector<Shape> mapped = mapped_shapes(scenario);
  if (std::none_of(mapped.begin(), mapped.end(),
                   [&](const Shape& shape) { return shape.is_at(height_m); })) {
    throw UsageError(
        fmt::format("{}: localiser.scan_height_m = {}: the map shows nothing at that height "
                    "(lidar.height_m, if it is not given)",
                    file, height_m));
  }
}

/// It knows its scanner, unless its noise is given.
void take_from_scanner(Scenario& scenario, const std::set<std::string>& given,
                       const std::string& /*file*/) {
  auto& localiser = scenario.get<LocaliserSettings>();
  const auto& lidar = scenario.get<LidarSettings>();
  if (localiser.place == LocaliserSettings::Place::none || !lidar.on()) return;
  if (!given.contains("localiser.scan_height_m")) localiser.scan_height_m = lidar.height_m;
  if (!given.contains("localiser.range_noise_m")) {
    constexpr double kUsualRange_m = 10.0;
    localiser.range_noise_m =
        std::max(1e-3, std::hypot(lidar.noise_m, lidar.noise_per_m * kUsualRange_m));
  }
}

/// Poses that are always too old, or get too old before the next one comes.
std::string warning_of_timeout(const Scenario& scenario) {
  const double timeout_s = scenario.get<ControllerSettings>().pose_timeout_s;
  const bool localises = scenario.get<LocaliserSettings>().place != LocaliserSettings::Place::none;
  if (timeout_s <= 0.0 || localises) return "";
  const double delay_s = pose_delay_s(scenario);
  const double period_s = 1.0 / scenario.get<SensorSettings>().rate_hz;
  if (timeout_s <= delay_s) {
    return fmt::format(
        "controller.pose_timeout_s = {:g} is not above the {:g} s that a pose takes "
        "(sensor.latency_ms and the uplink's delay): every pose is too old, the vehicle never "
        "drives",
        timeout_s, delay_s);
  }
  if (timeout_s >= delay_s + period_s) return "";
  return fmt::format(
      "controller.pose_timeout_s = {:g} is below the {:g} s that a pose takes (sensor.latency_ms "
      "and the uplink's delay) and the {:g} s between two (sensor.rate_hz): the vehicle stops "
      "before "
      "each of them",
      timeout_s, delay_s, period_s);
}

std::string why_ros2_has_no_effect(const Scenario& scenario, const std::string& key) {
  const bool is_off = key.starts_with("ros2.") && !scenario.get<ControllerSettings>().ros2;
  return is_off ? "controller.ros2 is false" : "";
}

}  // namespace

std::vector<std::string> scenario_warnings(const Scenario& scenario) {
  std::vector<std::string> all{medium_warning(scenario.get<MediumSettings>()),
                               warning_of_timeout(scenario)};
  std::erase(all, "");
  return all;
}

// In the order of the resolved scenario. It stands above the rooms that have the sections; all
// programs are linked with it.
std::vector<ScenarioSection> scenario_sections() {
  ScenarioSection actuator = actuator_section();
  actuator.check = check_timeout;
  ScenarioSection autonomy = autonomy_section();
  autonomy.check = [own = autonomy.check](const Scenario& scenario, const std::string& file) {
    own(scenario, file);
    check_autonomy(scenario, file);
  };
  ScenarioSection localiser = localiser_section();
  localiser.complete = take_from_scanner;
  localiser.check = check_inputs;
  ScenarioSection medium = medium_section();
  medium.check = [own = medium.check](const Scenario& scenario, const std::string& file) {
    own(scenario, file);
    check_keeping(scenario, file);
    for (const FleetSettings::Variant& variant : scenario.get<FleetSettings>().variants) {
      const std::string place = file + ": fleet.vehicle." + numbers_text(variant.numbers);
      own(*variant.scenario, place);
      check_keeping(*variant.scenario, place);
    }
  };
  // The last section that completes anything: what is sent follows from what all have completed.
  autonomy.complete = [own = autonomy.complete](Scenario& scenario,
                                                const std::set<std::string>& given,
                                                const std::string& file) {
    if (own) own(scenario, given, file);
    take_traffic(scenario);
  };
  ScenarioSection ros2 = ros2_section();
  ros2.why_no_effect = why_ros2_has_no_effect;
  ros2.left_out = [](const Scenario& scenario, const ScenarioKey& key) {
    return !why_ros2_has_no_effect(scenario, key.name).empty();
  };
  return {run_section(),
          world_section(),
          vehicle_section(),
          sensor_section(),
          path_section({controller_path_limits, vehicle_path_limits, can_path_limits}),
          controller_section(),
          actuator,
          can_section(),
          channel_section(),
          medium,
          surroundings_section(),
          fleet_section(),
          lidar_section(),
          localiser,
          autonomy,
          tube_section(),
          ros2};
}

}  // namespace tether
