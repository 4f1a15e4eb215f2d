#include "tests/campaign/trial.hpp"

#include <algorithm>
#include <cmath>

#include "common/base/random.hpp"

namespace tether::campaign {
namespace {

double between(RandomEngine& random, double low, double high) {
  return low + (high - low) * uniform_01(random);
}

Fault draw_fault(RandomEngine& random, const Trial& trial) {
  Fault fault;
  // The vehicle's random numbers have a stream of their own: with_vehicle().
  const auto rows = static_cast<double>(FaultKind::pushed);
  fault.kind = static_cast<FaultKind>(uniform_01(random) * rows);
  const FaultRow& row = row_of(fault.kind);
  fault.when = kStart + from_seconds(between(random, 0.3, to_seconds(trial.quiet) - 0.2));
  const double length_s = between(random, row.shortest_s, row.longest_s);
  fault.until = std::min(fault.when + from_seconds(length_s), trial.quiet);
  fault.share = uniform_01(random);
  fault.node = uniform_01(random) < 0.5 ? 1 : 2;
  return fault;
}

}  // namespace

const std::vector<FaultRow>& fault_rows() {
  using K = FaultKind;
  static const std::vector<FaultRow> rows{
      {K::loss, "messages lost", 0.1, 3.0},
      {K::delay, "messages late", 0.1, 3.0},
      {K::duplicates, "messages duplicated", 0.1, 3.0},
      {K::replay, "messages replayed", 0.1, 2.0},
      {K::forged_session, "forged session", 0.0, 0.5},
      {K::forged_nan, "forged not-a-number", 0.0, 0.5},
      {K::forged_huge, "forged huge number", 0.0, 0.5},
      {K::forged_future, "forged future stamp", 0.0, 0.5},
      {K::forged_number, "forged jump of numbers", 0.0, 0.5},
      {K::controller_silent, "controller silent", 0.1, 2.0},
      {K::controller_restarted, "controller restarted", 0.0, 0.5},
      {K::second_sender, "second sender", 0.1, 1.5},
      {K::frozen_pose, "poses frozen", 0.2, 3.0},
      {K::arm, "ARM", 0.0, 0.0},
      {K::disarm, "DISARM", 0.0, 0.0},
      {K::estop, "ESTOP", 0.0, 0.0},
      {K::release, "RELEASE", 0.0, 0.0},
      {K::reset, "RESET", 0.0, 0.0},
      {K::replayed_request, "request replayed", 0.0, 0.0},
      {K::late_request, "request late", 0.5, 2.5},
      {K::bridge_stalls, "bridge suspended", 0.01, 1.0},
      {K::bridge_restarted, "bridge killed and restarted", 0.01, 1.0},
      {K::nmt, "foreign NMT", 0.0, 0.0},
      {K::sdo_write, "foreign SDO write", 0.0, 0.2},
      {K::emcy, "EMCY", 0.0, 0.0},
      {K::foreign_master, "foreign setpoint, SYNC, heartbeat", 0.01, 0.4},
      {K::drive_fault, "drive fault", 0.0, 0.0},
      {K::drive_reboot, "drive reboot", 0.0, 0.0},
      {K::drive_silent, "drive silent", 0.05, 1.5},
      {K::sdo_abort, "drive aborts SDO", 0.1, 2.0},
      {K::encoder_freeze, "encoder frozen", 0.2, 3.0},
      {K::wheel_slip, "wheel slips", 0.2, 3.0},
      {K::bus_off, "bus-off", 0.0, 1.0},
      {K::bus_stalled, "bus stalled", 0.0, 1.0},
      {K::bus_down, "bus down", 0.0, 1.0},
      {K::error_passive, "bus error-passive", 0.0, 1.0},
      {K::pushed, "vehicle pushed", 0.2, 2.0},
      {K::weak_brake, "brakes weak", 0.2, 2.0}};
  return rows;
}

Trial draw_trial(std::uint64_t seed) {
  RandomEngine random = random_stream(seed, "trial");
  Trial t;
  t.seed = seed;
  t.plans = uniform_01(random) < 0.5;
  t.any = uniform_01(random) < 0.5;
  t.stubborn = uniform_01(random) < 0.05;
  t.eager = uniform_01(random) < 0.1;
  constexpr double kPeriods_s[] = {0.02, 0.05, 0.1};
  t.period_s = kPeriods_s[static_cast<int>(3.0 * uniform_01(random))];
  t.delay_s = between(random, 0.002, 0.06);
  t.pose_age_s = between(random, 0.0, 0.15);
  t.horizon_s = between(random, 0.3, 4.0);
  t.max_speed_mps = between(random, 0.3, 3.0);
  t.max_yaw_rate_radps = between(random, 0.3, 2.0);
  // Together no more than the drives' own 4 m/s^2 at a wheel (drivetrains/two_node_cia402.toml).
  t.deceleration_mps2 = between(random, 1.0, 2.0);
  t.yaw_deceleration_radps2 = between(random, 2.0, 3.0);
  t.max_blind_s = between(random, 0.4, 2.0);
  t.max_blind_m = between(random, 0.2, 2.0);
  t.patience_s = uniform_01(random) < 0.1 ? between(random, 1.0, 3.0) : between(random, 0.1, 0.5);
  t.quiet = kStart + from_seconds(between(random, 6.0, 11.0));
  t.end = t.quiet + std::chrono::seconds{4};
  const int faults = 1 + static_cast<int>(8.0 * uniform_01(random));
  for (int k = 0; k < faults; ++k) t.faults.push_back(draw_fault(random, t));
  return t;
}

Trial with_vehicle(Trial t) {
  RandomEngine random = random_stream(t.seed, "vehicle");
  t.brake = uniform_01(random) < 0.5;
  // Evenly by its logarithm, from steel on steel to a worm gear.
  t.coast_mps2 = 0.1 * std::pow(80.0, uniform_01(random));
  const int faults = static_cast<int>(3.0 * uniform_01(random));
  for (int k = 0; k < faults; ++k) {
    Fault fault = draw_fault(random, t);
    fault.kind = uniform_01(random) < 0.5 ? FaultKind::pushed : FaultKind::weak_brake;
    t.faults.push_back(fault);
  }
  // Pushing ends before the campaign's quiet, and the vehicle rolls out after it.
  if (!t.brake) t.end = t.quiet + std::chrono::seconds{4} + from_seconds(3.0 / t.coast_mps2);
  return t;
}

}  // namespace tether::campaign
