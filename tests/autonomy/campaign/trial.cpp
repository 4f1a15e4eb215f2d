#include "tests/autonomy/campaign/trial.hpp"

#include <fmt/format.h>

#include <cmath>
#include <optional>

#include "common/scenario/scenario.hpp"
#include "common/vehicle/motion_model.hpp"
#include "tests/autonomy/campaign/driving_rules.hpp"
#include "tests/autonomy/campaign/lossy_channel.hpp"
#include "tests/autonomy/support/scanner.hpp"

namespace tether::test {
namespace {

constexpr Duration kStep = std::chrono::milliseconds{20};
constexpr double kStep_s = 0.02;
constexpr double kEnd_s = 40.0;

const Scenario& scenario() {
  static const Scenario kScenario = parse_scenario(R"(
[vehicle]
start_x_m = -4.0
start_y_m = -4.0
[sensor]
odometry_rate_hz = 50.0
[path]
kind = "rounded_rectangle"
start_x_m = -4.0
start_y_m = -4.0
length_m = 12.0
width_m = 8.0
corner_radius_m = 2.0
speed_mps = 1.2
[lidar]
model = "custom"
[controller]
law = "detour"
[autonomy]
enabled = true
wait_s = 1.5
)",
                                                   "trial");
  return kScenario;
}

struct Report {
  Instant stamp;
  DriveState state;
};

struct Command {
  Instant stamp;
  std::int64_t seq;
  Twist twist;
  std::optional<Instant> report;
};

struct Thing {
  Shape shape;
  Instant gone;
  bool in_time;  ///< it came into being outside of the field
};

class Trial {
 public:
  Trial(std::uint64_t seed, Fault fault)
      : seed_(seed),
        random_(random_stream(seed, "trial")),
        autonomy_(scenario().get<AutonomySettings>()),
        vehicle_(scenario().get<VehicleSettings>()),
        stopping_(autonomy_),
        outline_(outline_of(vehicle_)),
        model_(
            {vehicle_.track_m, vehicle_.max_wheel_acceleration_mps2, vehicle_.max_wheel_speed_mps}),
        driver_(scenario()),
        fault_(fault, autonomy_, kStep_s),
        rules_(autonomy_, outline_, kStep_s),
        reports_(seed, "up", network()),
        commands_(seed, "down", network()) {
    state_.pose = {vehicle_.start_x_m, vehicle_.start_y_m, 0.0};
    kind_ = static_cast<int>(uniform_01(random_) * 3.0);
  }

  std::string run(TrialTotals& totals) {
    for (now_ = kStart - std::chrono::seconds{2}; to_seconds(now_) < kEnd_s; now_ += kStep) {
      change_world(totals);
      sense(totals);
      remote_side();
      vehicle_side();
      step(totals);
      if (!rules_.broken().empty()) {
        return fmt::format("seed {}, t = {:.2f} s: {}", seed_, to_seconds(now_), rules_.broken());
      }
    }
    CounterList counters;
    driver_.list(counters);
    for (const auto& [name, value] : counters) {
      if (name.starts_with("remote.") && name != "remote.accepted" && name != "remote.requests" &&
          name != "remote.silences") {
        totals.refused += value;
      }
      if (name == "remote.silences") totals.silences += value;
    }
    ++totals.runs;
    return "";
  }

 private:
  double between(double a, double b) { return a + (b - a) * uniform_01(random_); }
  /// One of three loses packets one by one, the others in bursts of up to 30: 3 s of reports.
  Network network() {
    Network network;
    if (uniform_01(random_) > 0.2) network.loss = between(0.0, 0.9);
    if (uniform_01(random_) > 0.33) network.mean_burst = between(1.0, 30.0);
    network.delay_s = between(0.0, 0.4);
    network.jitter_s = between(0.0, 0.2);
    return network;
  }
  double pace() const { return pace_mps(model_.twist(state_), outline_); }

  double gap_to(const Shape& shape) const {
    double gap_m = 1e9;
    for (const Shape& part : footprint(vehicle_, state_.pose)) {
      gap_m = std::min(gap_m, tether::gap_m(part, shape));
    }
    return gap_m;
  }

  void change_world(TrialTotals& totals) {
    std::erase_if(things_, [this](const Thing& thing) { return thing.gone <= now_; });
    if (uniform_01(random_) > 0.08 * kStep_s * 5.0 || things_.size() >= 4) return;
    const double angle = between(-3.1, 3.1), away_m = between(1.5, 6.0);
    const double x = state_.pose.x_m + away_m * std::cos(angle);
    const double y = state_.pose.y_m + away_m * std::sin(angle);
    const Shape shape = uniform_01(random_) < 0.5
                            ? cylinder(x, y, between(0.25, 0.5))
                            : box(x, y, between(0.5, 2.0), between(0.5, 2.0), between(0.0, 3.0));
    const double gap_m = gap_to(shape);
    if (gap_m <= 0.0) return;
    // A scan's period and a step go by before it is seen; setpoints may rise meanwhile.
    const double reach_m = stopping_.length_m(pace() + 0.1) + 0.2 * (pace() + 0.1);
    const double for_s = uniform_01(random_) < 0.3 ? 100.0 : between(0.5, 12.0);
    things_.push_back({shape, now_ + from_seconds(for_s), gap_m > reach_m});
    ++totals.obstacles;
  }

  void sense(TrialTotals& totals) {
    const auto tick = (now_ - kStart) / kStep;
    Twist rolls = model_.twist(state_);
    driver_.on_odometry(now_, state_.pose, rolls);
    if (uniform_01(random_) < 0.01 * kStep_s * 5.0 && now_ >= lost_until_) {
      lost_until_ = now_ + from_seconds(between(0.2, 8.0));
      silent_ = uniform_01(random_) < 0.5;
      ++totals.localisation_losses;
    }
    const bool lost = now_ < lost_until_;
    driver_.on_localisation(!lost || silent_);
    if (tick % 3 == 0 && !(lost && silent_)) {
      driver_.on_pose(
          now_, {state_.pose.x_m + between(-0.02, 0.02), state_.pose.y_m + between(-0.02, 0.02),
                 state_.pose.yaw_rad + between(-0.01, 0.01)});
    }
    if (uniform_01(random_) < 0.0005) scanner_dead_until_ = now_ + from_seconds(between(0.0, 2.0));
    if (tick % 4 == 0 && now_ >= scanner_dead_until_) {
      std::vector<Shape> shapes = hall(9.0);
      if (fault_.fault() != Fault::sees_no_obstacles) {
        for (const Thing& thing : things_) shapes.push_back(thing.shape);
      }
      driver_.on_scan(scanner_.scan(now_, state_.pose, shapes));
    }
  }

  /// An honest driver stands still until he is notified that he drives; a careless one drives as
  /// soon as he hears the request, and goes on after it; the third one names the newest report of
  /// the request before.
  void remote_side() {
    for (const Report& report : reports_.arrived(now_)) {
      if (newest_ && report.stamp <= newest_->stamp) continue;
      const bool asks =
          report.state == DriveState::remote_requested || report.state == DriveState::remote;
      if (asks && !asks_) of_before_ = named_;
      if (asks) named_ = report.stamp;
      asks_ = asks;
      newest_ = report;
    }
    if ((now_ - kStart) / kStep % 3 != 0 || uniform_01(random_) < 0.05) return;
    if (uniform_01(random_) < 0.02) wish_ = {between(-0.5, 1.5), between(-1.0, 1.0)};
    if (uniform_01(random_) < 0.02) wish_ = {};
    Command command{now_, seq_++, {}, std::nullopt};
    if (kind_ == 0) {
      if (asks_) command.report = named_;
      if (newest_ && newest_->state == DriveState::remote) command.twist = wish_;
    } else if (kind_ == 1) {
      command.report = named_;
      command.twist = wish_;
    } else {
      command.report = of_before_;
      command.twist = uniform_01(random_) < 0.5 ? wish_ : Twist{};
    }
    commands_.send(now_, command);
  }

  void vehicle_side() {
    for (const Command& c : commands_.arrived(now_)) {
      const bool asked = driver_.supervisor().state() == DriveState::remote_requested ||
                         driver_.supervisor().state() == DriveState::remote;
      if (asked && c.report && *c.report >= asked_ && now_ - *c.report <= std::chrono::seconds{1}) {
        last_fit_ = now_;
      }
      driver_.on_command(now_, c.stamp, c.seq, c.twist, c.report);
    }
    if (uniform_01(random_) < 0.0005) several_until_ = now_ + from_seconds(between(0.0, 1.0));
    driver_.on_senders(now_ < several_until_);
  }

  void step(TrialTotals& totals) {
    OnboardDriver::Output out = driver_.step(now_);
    fault_.spoil(now_, out);
    if (out.state == DriveState::remote_requested && state_before_ != out.state) asked_ = now_;
    rules_.check(now_, out, last_fit_);
    count(out, totals);
    if (out.state != state_before_ || (now_ - kStart) / kStep % 5 == 0) {
      reports_.send(now_, {now_, out.state});
    }
    state_before_ = out.state;
    // The wheels get it one step later.
    const double was = pace();
    model_.advance(state_, under_way_, kStep_s);
    under_way_ = fault_.wheels(now_, out);
    rules_.moved(0.5 * (was + pace()) * kStep_s);
    for (const Thing& thing : things_) {
      if (!thing.in_time) continue;
      const double gap_m = gap_to(thing.shape);
      totals.nearest_m = std::min(totals.nearest_m, gap_m);
      if (gap_m <= 0.0) rules_.broken("touches what stood in view");
    }
  }

  void count(const OnboardDriver::Output& out, TrialTotals& totals) const {
    if (out.state != state_before_) {
      totals.protective_stops += out.state == DriveState::protective_stop;
      totals.requests += out.state == DriveState::remote_requested;
      totals.returns += out.state == DriveState::returning;
    }
    if (pace_mps(out.setpoint, outline_) == 0.0) return;
    totals.law_steps += out.driver == Driver::law;
    totals.remote_steps += out.driver == Driver::remote;
  }

  std::uint64_t seed_;
  RandomEngine random_;
  AutonomySettings autonomy_;
  VehicleConfig vehicle_;
  StoppingField stopping_;
  Outline outline_;
  MotionModel model_;
  MotionModel::State state_;
  OnboardDriver driver_;
  FaultyDriver fault_;
  DrivingRules rules_;
  Scanner scanner_{
      .mount = {0.5, 0.0, 0.0}, .beams = 180, .step_rad = std::numbers::pi / 90.0, .range_m = 14.0};
  LossyChannel<Report> reports_;
  LossyChannel<Command> commands_;
  std::vector<Thing> things_;
  Instant now_{};

  int kind_ = 0;
  std::optional<Report> newest_;
  std::optional<Instant> named_, of_before_;
  bool asks_ = false;
  Twist wish_;
  std::int64_t seq_ = 0;
  Instant lost_until_{}, scanner_dead_until_{}, several_until_{};
  bool silent_ = false;

  DriveState state_before_ = DriveState::autonomous;
  Twist under_way_;
  Instant asked_ = Instant::max();
  Instant last_fit_{};
};

}  // namespace

void TrialTotals::add(const TrialTotals& other) {
  runs += other.runs;
  protective_stops += other.protective_stops;
  requests += other.requests;
  remote_steps += other.remote_steps;
  law_steps += other.law_steps;
  returns += other.returns;
  refused += other.refused;
  silences += other.silences;
  obstacles += other.obstacles;
  localisation_losses += other.localisation_losses;
  nearest_m = std::min(nearest_m, other.nearest_m);
}

std::string run_trial(std::uint64_t seed, TrialTotals& totals, Fault fault) {
  return Trial(seed, fault).run(totals);
}

}  // namespace tether::test
