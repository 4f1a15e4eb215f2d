#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/time.hpp"

namespace tether::campaign {

/// Kinds of faults in a trial. A row of kFaultKinds each.
enum class FaultKind : std::uint8_t {
  loss,        ///< loss of the controllers' messages
  delay,       ///< additional delay of messages
  duplicates,  ///< duplicated messages
  replay,      ///< messages of earlier in the run once more
  forged_session,
  forged_nan,
  forged_huge,
  forged_future,
  forged_number,  ///< a jump of the numbering
  controller_silent,
  controller_restarted,
  second_sender,
  frozen_pose,  ///< uplink dead: commands go on from an old pose
  arm,          ///< unexpected requests …
  disarm,
  estop,
  release,
  reset,
  replayed_request,
  late_request,
  bridge_stalls,     ///< its process is suspended
  bridge_restarted,  ///< killed; a new one comes, once a run
  nmt,               ///< NMT commands of an unknown sender
  sdo_write,         ///< by an unknown sender
  emcy,              ///< in a drive's name
  foreign_master,
  drive_fault,
  drive_reboot,
  drive_silent,
  sdo_abort,
  encoder_freeze,
  wheel_slip,
  bus_off,
  bus_stalled,
  bus_down,
  error_passive,
  pushed,      ///< a load accelerates wheels without power
  weak_brake,  ///< stops are acknowledged, and the ramps act in part
};

struct FaultRow {
  FaultKind kind;
  const char* name;
  double shortest_s;  ///< how long it lasts
  double longest_s;
};
const std::vector<FaultRow>& fault_rows();
inline const FaultRow& row_of(FaultKind kind) {
  return fault_rows()[static_cast<std::size_t>(kind)];
}

struct Fault {
  FaultKind kind{};
  Instant when;
  Instant until;
  double share = 0.0;  ///< 0…1: how bad; its meaning depends on the kind
  int node = 0;        ///< 1 or 2
};

/// All that is random about a run but the single messages: its settings, who drives, what goes
/// wrong and when. From `quiet` on no controller, operator or fault does anything any more.
struct Trial {
  std::uint64_t seed = 0;
  bool plans = false;  ///< else twists
  bool any = false;  ///< plans are based on any, not on what the vehicle follows; twists on no pose
  bool stubborn = false;   ///< the controller commands motion whether or not the vehicle is armed
  bool eager = false;      ///< it does so while the drives are being switched on
  double period_s = 0.05;  ///< period of the controller
  double delay_s = 0.02;   ///< delay of its messages, up to 10 ms more
  double pose_age_s = 0.05;
  double horizon_s = 2.0;  ///< horizon of plans
  double max_speed_mps = 1.0;
  double max_yaw_rate_radps = 1.0;
  double deceleration_mps2 = 1.5;
  double yaw_deceleration_radps2 = 3.0;
  double max_blind_s = 1.0;
  double max_blind_m = 1.0;
  bool brake = true;        ///< holds wheels without power; else they coast …
  double coast_mps2 = 1.0;  ///< … at this deceleration
  double patience_s = 0.3;  ///< patience of the operator: between requests, and half of it before
  std::vector<Fault> faults;
  Instant quiet;
  Instant end;
};

Trial draw_trial(std::uint64_t seed);
/// The same with another vehicle: how it coasts, and what pushes it or weakens its brakes.
Trial with_vehicle(Trial trial);

}  // namespace tether::campaign
