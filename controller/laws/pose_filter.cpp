#include "controller/laws/pose_filter.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "common/vehicle/dead_reckoning.hpp"

namespace tether {
namespace {

constexpr int kN = static_cast<int>(PoseFilter::kStates);
using Square = Eigen::Matrix<double, kN, kN, Eigen::RowMajor>;
using Column = Eigen::Matrix<double, kN, 1>;

enum Index { kX, kY, kYaw, kLeft, kRight, kLeftAim, kRightAim, kScale, kTurn, kLag, kBias, kSpin };

Eigen::Map<Square> square(PoseFilter::Covariance& a) { return Eigen::Map<Square>(a.data()); }
Eigen::Map<const Square> square(const PoseFilter::Covariance& a) {
  return Eigen::Map<const Square>(a.data());
}

/// Prior of a parameter before the first pose, and its random walk: standard deviations,
/// at first and after 1 s.
struct Prior {
  int index;
  double at_first;
  double wander_psqrts;
};
constexpr Prior kRadiusPrior{kScale, 0.03, 2e-4};
constexpr Prior kTrackPrior{kTurn, 0.03, 2e-4};
constexpr Prior kLagPrior{kLag, 0.08, 1e-3};
constexpr Prior kBiasPrior{kBias, 0.01, 5e-3};
constexpr Prior kSpinPrior{kSpin, 0.003, 2e-3};

template <class Function>
void for_adapted(const Adaptation& adapt, Function use) {
  if (adapt.radius) use(kRadiusPrior);
  if (adapt.track) use(kTrackPrior);
  if (adapt.lag) use(kLagPrior);
  if (adapt.bias) use(kBiasPrior);
  if (adapt.bias) use(kSpinPrior);
}

double squared(double x) { return x * x; }

// Noise of rim speeds from encoders.
constexpr double kReadNoise_mps = 0.02;
// Noise of the response to commands. Encoders are better; but that they read 1 m/s more for a
// moment, because the first plan came on board sooner than is thought, must not be taken for
// another lag. Tried from 0.02 to 0.3 in closed loops (docs/explanation/estimation.md).
constexpr double kLagNoise_mps = 0.3;

/// p := f p fᵀ. The only products of this size, because compiling one takes seconds.
void propagate(Eigen::Map<Square> p, const Square& f) {
  const Square moved = f * p;
  p.noalias() = moved * f.transpose();
}

/// The covariance after a measurement by `h` with white noise of these variances: Joseph's form
/// keeps it symmetric and positive.
template <int kRows>
void shrink(Eigen::Map<Square> p, const Eigen::Matrix<double, kN, kRows>& gain,
            const Eigen::Matrix<double, kRows, kN>& h,
            const Eigen::Matrix<double, kRows, 1>& noise) {
  const Square keep = Square::Identity() - gain * h;
  propagate(p, keep);
  p += gain * noise.asDiagonal() * gain.transpose();
}

/// Rows of one wheel: its aim and its speed after the step.
void fill_wheel(Square& f, int rim, int aim, const MotionModel& model, double before_mps,
                double aim_before_mps, double aim_after_mps, const Twist& command, double sign,
                double dt_s) {
  const DriveModel& drive = model.drive();
  const double turn_mps = sign * 0.5 * model.limits().track_m * command.omega_radps;
  const double target_mps = drive.rim_scale * (command.v_mps + drive.turn_scale * turn_mps);
  const double share = dt_s / (drive.lag_s + dt_s);
  f(aim, aim) = 1.0 - share;
  f(aim, kScale) = share * target_mps / drive.rim_scale;
  f(aim, kTurn) = share * drive.rim_scale * turn_mps;
  f(aim, kLag) = -dt_s / squared(drive.lag_s + dt_s) * (target_mps - aim_before_mps);
  const double most_mps = model.limits().max_wheel_acceleration_mps2 * dt_s;
  const bool free = std::abs(aim_after_mps - before_mps) <= most_mps;
  if (free) f.row(rim) = f.row(aim);  // else it is on its way, and keeps the identity's row
}

}  // namespace

PoseFilter::PoseFilter(const PoseFilterSettings& settings, const Adaptation& adapt,
                       const MotionModel::Limits& limits, const Pose2& start)
    : settings_(settings), adapt_(adapt), model_(limits, {.lag_s = settings.lag_ms * 1e-3}) {
  state_.pose = start;
  auto p = square(covariance_);
  p(kX, kX) = p(kY, kY) = squared(settings_.start_m);
  p(kYaw, kYaw) = squared(settings_.start_rad);
  if (adapt_.any()) {  // parameters that are not adapted are considered
    for (const Prior& prior : {kRadiusPrior, kTrackPrior, kLagPrior}) {
      p(prior.index, prior.index) = squared(prior.at_first);
    }
  }
  for_adapted(adapt_,
              [&](const Prior& prior) { p(prior.index, prior.index) = squared(prior.at_first); });
  if (settings_.radius_error) p(kScale, kScale) = squared(*settings_.radius_error);
  if (settings_.track_error) p(kTurn, kTurn) = squared(*settings_.track_error);
}

bool PoseFilter::stands() const {
  const auto rests = [](const WheelSpeeds& w) {
    return std::abs(w.left_mps) < 1e-6 && std::abs(w.right_mps) < 1e-6;
  };
  return rests(state_.rim) && rests(state_.lagging);
}

void PoseFilter::advance(const Twist& command, double dt_s) {
  const bool told_to_stand = command.v_mps == 0.0 && command.omega_radps == 0.0;
  const double steps = std::ceil(dt_s / MotionModel::kShort_s - 1e-9);
  for (double i = 0.0; i < steps; i += 1.0) {
    if (told_to_stand && stands()) return;
    step(command, dt_s / steps);
  }
}

void PoseFilter::step(const Twist& command, double dt_s) {
  const MotionModel::State before = state_;
  model_.advance(state_, command, dt_s);
  const Covariance jacobian = PoseFilter::jacobian(model_, before, state_, command, dt_s);
  propagate(square(covariance_), square(jacobian));
  widen_by(dt_s);
}

/// Adds the drift of the pose and the random walk of the parameters.
void PoseFilter::widen_by(double dt_s) {
  auto p = square(covariance_);
  p(kX, kX) += squared(settings_.position_drift_mpsqrts) * dt_s;
  p(kY, kY) += squared(settings_.position_drift_mpsqrts) * dt_s;
  p(kYaw, kYaw) += squared(settings_.yaw_drift_radpsqrts) * dt_s;
  for_adapted(adapt_, [&](const Prior& prior) {
    p(prior.index, prior.index) += squared(prior.wander_psqrts) * dt_s;
  });
}

void PoseFilter::roll(const Rolled& rolled, double dt_s) {
  const DriveModel& drive = model_.drive();
  const double track_m = model_.limits().track_m;
  ++rolled_;
  const WheelSpeeds read =
      to_wheel_speeds({rolled.at_end.v_mps, drive.turn_scale * rolled.at_end.omega_radps}, track_m);
  state_.rim = {drive.rim_scale * read.left_mps, drive.rim_scale * read.right_mps};
  state_.lagging = state_.rim;
  const bool stood = rolled.distance_m == 0.0 && rolled.turn_rad == 0.0;
  const double added_s = stood ? 0.0 : dt_s;
  // Its own way and turn, scaled, on a chord that turns by half of what the turn is more.
  const double scale_turn = drive.rim_scale * drive.turn_scale;
  const double turn_rad = scale_turn * rolled.turn_rad + drive.omega_bias_radps * added_s;
  const double to_world_rad = state_.pose.yaw_rad + 0.5 * (turn_rad - rolled.turn_rad);
  const double c = drive.rim_scale * std::cos(to_world_rad);
  const double s = drive.rim_scale * std::sin(to_world_rad);
  const double middle_rad = state_.pose.yaw_rad + 0.5 * turn_rad;
  const double added_m = drive.v_bias_mps * added_s;
  const double rolled_x_m = c * rolled.x_m - s * rolled.y_m;
  const double rolled_y_m = s * rolled.x_m + c * rolled.y_m;
  const double dx_m = rolled_x_m + added_m * std::cos(middle_rad);
  const double dy_m = rolled_y_m + added_m * std::sin(middle_rad);
  Square f = Square::Identity();
  const auto turn_by = [&](int index, double rate) {  // derivative of the turn by a parameter
    f(kYaw, index) += rate;
    f(kX, index) -= 0.5 * rate * dy_m;
    f(kY, index) += 0.5 * rate * dx_m;
  };
  f(kX, kYaw) = -dy_m;
  f(kY, kYaw) = dx_m;
  f(kX, kScale) = rolled_x_m / drive.rim_scale;
  f(kY, kScale) = rolled_y_m / drive.rim_scale;
  turn_by(kScale, drive.turn_scale * rolled.turn_rad);
  turn_by(kTurn, drive.rim_scale * rolled.turn_rad);
  f(kX, kBias) = std::cos(middle_rad) * added_s;
  f(kY, kBias) = std::sin(middle_rad) * added_s;
  turn_by(kSpin, added_s);
  const double half_turn_mps = 0.5 * track_m * drive.rim_scale * rolled.at_end.omega_radps;
  for (const int wheel : {kLeft, kLeftAim, kRight, kRightAim}) {
    const bool left = wheel == kLeft || wheel == kLeftAim;
    f(wheel, wheel) = 0.0;
    f(wheel, kScale) = left ? read.left_mps : read.right_mps;
    f(wheel, kTurn) = left ? -half_turn_mps : half_turn_mps;
  }
  propagate(square(covariance_), f);
  state_.pose.x_m += dx_m;
  state_.pose.y_m += dy_m;
  state_.pose.yaw_rad = wrap_angle(state_.pose.yaw_rad + turn_rad);
  if (!stood) widen_rolled(rolled.distance_m, middle_rad, dt_s);
}

/// Each wheel's way has this variance: half of it in the mean, twice in the difference. The drift
/// is that of the same motion, so the larger counts.
void PoseFilter::widen_rolled(double distance_m, double direction_rad, double dt_s) {
  auto p = square(covariance_);
  widen_by(dt_s);
  const double way_m2 = DeadReckoning::kVariancePerMetre * distance_m;
  const double more_m2 =
      std::max(0.0, 0.5 * way_m2 - squared(settings_.position_drift_mpsqrts) * dt_s);
  const double c = std::cos(direction_rad), s = std::sin(direction_rad);
  p(kX, kX) += more_m2 * c * c;
  p(kY, kY) += more_m2 * s * s;
  p(kX, kY) += more_m2 * c * s;
  p(kY, kX) = p(kX, kY);
  p(kYaw, kYaw) += std::max(0.0, 2.0 * way_m2 / squared(model_.limits().track_m) -
                                     squared(settings_.yaw_drift_radpsqrts) * dt_s);
  for (const int wheel : {kLeft, kLeftAim, kRight, kRightAim}) {
    p(wheel, wheel) += squared(kReadNoise_mps);
  }
}

PoseFilter::Covariance PoseFilter::jacobian(const MotionModel& model,
                                            const MotionModel::State& before,
                                            const MotionModel::State& after, const Twist& command,
                                            double dt_s) {
  Square f = Square::Identity();
  fill_wheel(f, kLeft, kLeftAim, model, before.rim.left_mps, before.lagging.left_mps,
             after.lagging.left_mps, command, -1.0, dt_s);
  fill_wheel(f, kRight, kRightAim, model, before.rim.right_mps, before.lagging.right_mps,
             after.lagging.right_mps, command, 1.0, dt_s);
  // Each wheel rolls by the mean of its speeds.
  const double track_m = model.limits().track_m;
  Column left_m = 0.5 * dt_s * f.row(kLeft).transpose();
  Column right_m = 0.5 * dt_s * f.row(kRight).transpose();
  left_m(kLeft) += 0.5 * dt_s;
  right_m(kRight) += 0.5 * dt_s;
  Column arc_m = 0.5 * (left_m + right_m);
  Column turn_rad = (right_m - left_m) / track_m;
  arc_m(kBias) = dt_s;
  turn_rad(kSpin) = dt_s;
  const double arc =
      0.25 * dt_s *
          (before.rim.left_mps + after.rim.left_mps + before.rim.right_mps + after.rim.right_mps) +
      model.drive().v_bias_mps * dt_s;
  const double yaw_rad =
      before.pose.yaw_rad + 0.5 * wrap_angle(after.pose.yaw_rad - before.pose.yaw_rad);
  Column heading_rad = 0.5 * turn_rad;
  heading_rad(kYaw) += 1.0;
  const double c = std::cos(yaw_rad), s = std::sin(yaw_rad);
  f.row(kX) += (c * arc_m - s * arc * heading_rad).transpose();
  f.row(kY) += (s * arc_m + c * arc * heading_rad).transpose();
  f.row(kYaw) += turn_rad.transpose();
  Covariance out{};
  square(out) = f;
  return out;
}

/// A pose against what is expected.
struct PoseFilter::Innovation {
  Eigen::Vector3d value;
  Eigen::Vector3d noise;
  Eigen::LDLT<Eigen::Matrix3d> spread;

  Innovation(const PoseFilter& filter, const Pose2& measured)
      : value{measured.x_m - filter.state_.pose.x_m, measured.y_m - filter.state_.pose.y_m,
              wrap_angle(measured.yaw_rad - filter.state_.pose.yaw_rad)},
        noise{squared(filter.settings_.position_noise_m),
              squared(filter.settings_.position_noise_m), squared(filter.settings_.yaw_noise_rad)},
        spread(square(filter.covariance_).topLeftCorner<3, 3>() +
               Eigen::Matrix3d(noise.asDiagonal())) {}
  double nis() const { return value.dot(spread.solve(value)); }
};

PoseFilter::Fit PoseFilter::fit(const Pose2& measured) const {
  const Innovation innovation(*this, measured);
  const double nis = innovation.nis();
  return {nis, -0.5 * (nis + std::log(innovation.spread.vectorD().prod()))};
}

void PoseFilter::correct(const Pose2& measured) { correct(Innovation(*this, measured)); }

void PoseFilter::correct(const Innovation& innovation) {
  auto p = square(covariance_);
  Eigen::Matrix<double, kN, 3> gain =
      innovation.spread.solve(Eigen::Matrix<double, 3, kN>(p.topRows<3>())).transpose();
  keep_considered(gain);
  const Column correction = gain * innovation.value;
  shrink<3>(p, gain, Eigen::Matrix<double, 3, kN>::Identity(), innovation.noise);
  add(correction.data());
}

PoseFilter::Verdict PoseFilter::update(const Pose2& measured, bool gates) {
  const Innovation innovation(*this, measured);
  last_nis_ = innovation.nis();
  if (gates && !(last_nis_ <= kGate)) {
    const Pose2 gone{innovation.value(0), innovation.value(1), innovation.value(2)};
    agreeing_ = agreeing_ > 0 && agrees(gone) ? agreeing_ + 1 : 1;
    last_gated_ = gone;
    ++gated_;
    if (++in_a_row_ < kMostGated && agreeing_ < kAgreeing) return Verdict::gated;
    ++resets_;
    forget_pose(measured);
    return Verdict::reset;
  }
  agreeing_ = in_a_row_ = 0;
  ++accepted_;
  sum_nis_ += last_nis_;
  correct(innovation);
  return Verdict::accepted;
}

void PoseFilter::take(const PoseFilter& other) {
  state_ = other.state_;
  covariance_ = other.covariance_;
  model_ = other.model_;
}

void PoseFilter::mix(const PoseFilter& other, double share) {
  Vector mean = values();
  const Vector others = other.values();
  Column apart;
  for (int i = 0; i < kN; ++i) {
    const auto at = static_cast<std::size_t>(i);
    apart(i) = i == kYaw ? wrap_angle(others[at] - mean[at]) : others[at] - mean[at];
    mean[at] += share * apart(i);
  }
  auto p = square(covariance_);
  p = (1.0 - share) * p + share * square(other.covariance_) +
      share * (1.0 - share) * apart * apart.transpose();
  set_values(mean);
}

/// Zeroes the gain of parameters that are not adapted.
template <class Gain>
void PoseFilter::keep_considered(Gain& gain) const {
  if (!adapt_.radius) gain.row(kScale).setZero();
  if (!adapt_.track) gain.row(kTurn).setZero();
  if (!adapt_.lag) gain.row(kLag).setZero();
}

void PoseFilter::update_lag(const LagReading& reading) {
  if (!adapt_.lag) return;
  Eigen::Matrix<double, 2, kN> h = Eigen::Matrix<double, 2, kN>::Zero();
  h(0, kLag) = reading.by_lag_mps2.left_mps;
  h(1, kLag) = reading.by_lag_mps2.right_mps;
  const Eigen::Vector2d innovation{reading.more.left_mps, reading.more.right_mps};
  const Eigen::Vector2d noise{squared(kLagNoise_mps), squared(kLagNoise_mps)};
  auto p = square(covariance_);
  const Eigen::Matrix<double, kN, 2> together = p * h.transpose();
  const Eigen::LDLT<Eigen::Matrix2d> solver(h * together + Eigen::Matrix2d(noise.asDiagonal()));
  if (!(innovation.dot(solver.solve(innovation)) <= kWheelGate)) return;
  ++lag_used_;
  Eigen::Matrix<double, kN, 2> gain = solver.solve(together.transpose()).transpose();
  keep_considered(gain);
  const Column correction = gain * innovation;
  shrink<2>(p, gain, h, noise);
  add(correction.data());
}

void PoseFilter::add(const double* correction) {
  Vector now = values();
  for (std::size_t i = 0; i < kStates; ++i) now[i] += correction[i];
  set_values(now);
}

void PoseFilter::widen(double position_m) {
  auto p = square(covariance_);
  p(kX, kX) += squared(position_m);
  p(kY, kY) += squared(position_m);
}

void PoseFilter::restart(const Pose2& measured, const WheelSpeeds& rim) {
  forget_pose(measured);
  state_.rim = state_.lagging = rim;
}

void PoseFilter::forget_pose(const Pose2& measured) {
  agreeing_ = in_a_row_ = 0;
  state_.pose = measured;
  auto p = square(covariance_);
  p.topRows<3>().setZero();
  p.leftCols<3>().setZero();
  p(kX, kX) = p(kY, kY) = squared(settings_.position_noise_m);
  p(kYaw, kYaw) = squared(settings_.yaw_noise_rad);
}

/// Whether two gated poses in a row see the vehicle in the same other place.
bool PoseFilter::agrees(const Pose2& innovation) const {
  const double dx_m = innovation.x_m - last_gated_.x_m, dy_m = innovation.y_m - last_gated_.y_m;
  const double dyaw_rad = wrap_angle(innovation.yaw_rad - last_gated_.yaw_rad);
  const double position = squared(settings_.position_noise_m) + covariance_[0];
  const double yaw = squared(settings_.yaw_noise_rad) + covariance_[kYaw * kStates + kYaw];
  return (squared(dx_m) + squared(dy_m)) / (2.0 * position) + squared(dyaw_rad) / (2.0 * yaw) <=
         kGate;
}

PoseFilter::Vector PoseFilter::values() const {
  const DriveModel& d = model_.drive();
  return {state_.pose.x_m,
          state_.pose.y_m,
          state_.pose.yaw_rad,
          state_.rim.left_mps,
          state_.rim.right_mps,
          state_.lagging.left_mps,
          state_.lagging.right_mps,
          d.rim_scale,
          d.turn_scale,
          d.lag_s,
          d.v_bias_mps,
          d.omega_bias_radps};
}

void PoseFilter::set_values(const Vector& v) {
  state_.pose = {v[kX], v[kY], wrap_angle(v[kYaw])};
  state_.rim = {v[kLeft], v[kRight]};
  state_.lagging = {v[kLeftAim], v[kRightAim]};
  model_ =
      MotionModel(model_.limits(),
                  {.rim_scale = std::clamp(v[kScale], 1.0 - kMostScale, 1.0 + kMostScale),
                   .turn_scale = std::clamp(v[kTurn], 1.0 - kMostScale, 1.0 + kMostScale),
                   .lag_s = std::clamp(v[kLag], 0.0, kMostLag_s),
                   .v_bias_mps = std::clamp(v[kBias], -kMostBias_mps, kMostBias_mps),
                   .omega_bias_radps = std::clamp(v[kSpin], -kMostBias_radps, kMostBias_radps)});
}

double PoseFilter::standard_deviation(std::size_t i) const {
  return std::sqrt(covariance_[i * kStates + i]);
}

double PoseFilter::mean_nis() const {
  return accepted_ == 0 ? 0.0 : sum_nis_ / static_cast<double>(accepted_);
}

void PoseFilter::list_counters(CounterList& out) const {
  out.emplace_back("ekf.accepted", accepted_);
  out.emplace_back("ekf.gated", gated_);
  out.emplace_back("ekf.resets", resets_);
  out.emplace_back("ekf.nis_per_mille", std::llround(mean_nis() * 1e3));
  if (rolled_ > 0) out.emplace_back("ekf.rolled", rolled_);
  const DriveModel& drive = model_.drive();
  const auto millionths = [](double x) { return std::llround(x * 1e6); };
  if (adapt_.radius) out.emplace_back("ekf.radius_ppm", millionths(drive.rim_scale - 1.0));
  if (adapt_.track) out.emplace_back("ekf.track_ppm", millionths(drive.turn_scale - 1.0));
  if (adapt_.lag) out.emplace_back("ekf.lag_us", millionths(drive.lag_s));
  if (adapt_.bias) out.emplace_back("ekf.bias_um_per_s", millionths(drive.v_bias_mps));
  if (adapt_.bias) out.emplace_back("ekf.bias_urad_per_s", millionths(drive.omega_bias_radps));
}

}  // namespace tether
