#include "tests/campaign/witness.hpp"

#include <algorithm>
#include <cmath>
#include <tether/drive_request_t.hpp>
#include <tether/plan_t.hpp>
#include <tether/twist_t.hpp>

#include "common/node/message_io.hpp"
#include "common/vehicle/plan.hpp"

namespace tether::campaign {
namespace {

/// Stamps farther ahead are refused (docs/reference/drivetrain.md, "Age").
constexpr Duration kMaxAhead = std::chrono::milliseconds{50};
/// Requests act within this time of their stamp (docs/reference/drivetrain.md, "Requests").
constexpr Duration kRequestFresh = std::chrono::seconds{1};

bool is_zero(const Twist& twist) {
  return std::abs(twist.v_mps) < 1e-3 && std::abs(twist.omega_radps) < 1e-3;
}

bool fits_in_time(Instant now, Instant stamp) {
  return stamp >= kStart && stamp <= now + kMaxAhead;
}

/// When the plan first says to move.
Instant moves_from(const Plan& plan) {
  for (std::size_t k = 0; k < plan.twists.size(); ++k) {
    if (!is_zero(plan.twists[k])) return plan.start + plan.step * static_cast<std::int64_t>(k);
  }
  return Instant::max();
}

}  // namespace

void Witness::on_message(Instant now, const Message& message) {
  if (message.channel == "AGV/CMD_VEL") on_twist(now, message);
  if (message.channel == "AGV/PLAN") on_plan(now, message);
  if (message.channel == "CAN/REQUEST") on_request(now, message);
}

void Witness::on_twist(Instant now, const Message& message) {
  twist_t m{};
  if (!decode(message.bytes, m)) return;
  const Instant stamp = from_utime(m.utime);
  const Twist twist{m.v_mps, m.omega_radps};
  if (!is_usable(twist) || !fits_in_time(now, stamp)) return;
  const auto pose = pose_time(m.pose_utime);
  if (pose && *pose + record_.limits.max_blind <= now) return;
  CommandSample sample;
  sample.when = now;
  sample.as_of = std::min(stamp, now);
  sample.moves_from = is_zero(twist) ? Instant::max() : now;
  record_.commands.push_back(sample);
}

void Witness::on_plan(Instant now, const Message& message) {
  plan_t m{};
  if (!decode(message.bytes, m) || m.step_us <= 0 || m.count <= 0) return;
  const Plan plan = to_plan(m);
  const bool usable = std::all_of(plan.twists.begin(), plan.twists.end(),
                                  [](const Twist& u) { return is_usable(u); });
  if (!usable || !fits_in_time(now, plan.stamp) || !plan.pose || *plan.pose > now + kMaxAhead) {
    return;
  }
  CommandSample sample;
  sample.when = now;
  sample.plan = true;
  sample.as_of = plan.end();
  sample.seen = std::min({*plan.pose, plan.stamp, now});
  sample.moves_from = moves_from(plan);
  record_.commands.push_back(sample);
}

void Witness::on_request(Instant now, const Message& message) {
  drive_request_t m{};
  if (!decode(message.bytes, m)) return;
  const Instant stamp = from_utime(m.utime);
  const bool stop = m.request == drive_request_t::ESTOP || m.request == drive_request_t::DISARM;
  const bool fresh = fits_in_time(now, stamp) && now - stamp <= kRequestFresh;
  const bool acts = stop || (fresh && used_requests_.insert({m.utime, m.seq}).second);
  record_.requests.push_back({now, m.request, acts});
}

}  // namespace tether::campaign
