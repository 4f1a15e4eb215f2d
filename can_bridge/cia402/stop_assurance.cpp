#include "can_bridge/cia402/stop_assurance.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace tether::cia402 {
namespace {

using std::chrono::milliseconds;

/// How long an operational drive may take to confirm a stop, before it gets it by SDO, too.
constexpr Duration kPatience = milliseconds(100);
/// Margin for a vendor's watchdog on top of its own time.
constexpr Duration kWatchdogMargin = milliseconds(100);

}  // namespace

Duration StopAssurance::confirmation_time() const {
  return std::max(milliseconds(200), 2 * milliseconds(d_.config.feedback_timeout_ms));
}

bool StopAssurance::stop_is_commanded(Instant now) const {
  switch (d_.stage.stage()) {
    case Stage::stopping:
      return true;
    case Stage::faulted:
      if (d_.commanding) return true;
      [[fallthrough]];  // another sender may have switched it on before start-up was done
    case Stage::refused:
      return d_.axes.in_doubt(0, now) || d_.axes.in_doubt(1, now);
    default:
      return false;
  }
}

void StopAssurance::begin(Instant now) {
  since_ = now;
  obeyed_ = {};
}

void StopAssurance::end(Instant now) {
  using Verdict = StandstillInquiry::Verdict;
  since_.reset();
  withheld_since_.reset();
  recalled_.reset();
  const Stage stage = d_.stage.stage();
  const bool asking = stage == Stage::listening || stage == Stage::securing;
  for (Node& node : d_.nodes) {
    node.by_sdo = false;
    // A drive that was lost, or runs and has not obeyed in time, stays without heartbeat until it
    // says that it obeys or stands.
    const bool overdue =
        stage == Stage::securing && node.heard && d_.stage.elapsed(now) >= confirmation_time();
    const bool confirmed =
        node.inquiry.verdict() == Verdict::standing || node.inquiry.obeys() || node.booted();
    node.unconfirmed =
        asking && (node.lost || overdue) && !confirmed && !in_reach_of_pdos(node, now);
  }
}

std::optional<Fault> StopAssurance::tick(Instant now, std::vector<CanFrame>& nmt) {
  if (!stop_is_commanded(now)) {
    end(now);
    return std::nullopt;
  }
  if (!since_) begin(now);
  for (std::size_t i = 0; i < d_.axes.size(); ++i) {
    // It stays so until the drive says otherwise.
    const auto state = d_.axes[i].confirmed_state();
    obeyed_[i] = obeys_quick_stop(state) || (obeyed_[i] && !state);
  }
  std::string names;
  for (Node& node : d_.nodes) {
    look_at(node, now);
    if (node.unconfirmed) names += (names.empty() ? "" : ", ") + node.name;
  }
  if (std::ranges::any_of(d_.nodes, &Node::by_sdo) &&
      (!recalled_ || now - *recalled_ >= Drives::kRecall)) {
    recalled_ = now;
    for (const Node& node : d_.nodes) {
      if (!node.by_sdo || node.state != canopen::NmtState::stopped) continue;
      nmt.push_back(canopen::nmt_frame(canopen::NmtCommand::pre_operational, node.id));
    }
  }
  if (names.empty()) {
    withheld_since_.reset();
    return std::nullopt;
  }
  if (!withheld_since_) {
    withheld_since_ = now;
    ++times_withheld_;
  }
  return Fault{fmt::format("{}: does not confirm its stop: check the CAN plug, and that it is "
                           "operational",
                           names),
               true, Fault::Cause::feedback};
}

void StopAssurance::look_at(Node& node, Instant now) {
  bool confirmed = true, in_doubt = false;
  for (std::size_t i = 0; i < d_.axes.size(); ++i) {
    if (d_.axes[i].node() != node.id) continue;
    confirmed = confirmed && is_confirmed(i, now);
    in_doubt = in_doubt || d_.axes.in_doubt(i, now);
  }
  const Duration elapsed = now - *since_;
  node.unconfirmed = !confirmed && (in_doubt || d_.commanding) && elapsed >= confirmation_time();
  const bool by_sdo = in_doubt && (node.by_sdo || !in_reach_of_pdos(node, now) ||
                                   (!confirmed && elapsed >= kPatience));
  if (by_sdo && !node.by_sdo) node.stopper.begin(true);
  node.by_sdo = by_sdo;
}

bool StopAssurance::is_confirmed(std::size_t i, Instant now) const {
  const Axis& axis = d_.axes[i];
  // Braking says whether an axis that is stopped by its setpoint does brake.
  const bool takes_setpoint = d_.axes.stops_by_setpoint(i) && axis.fresh(now) &&
                              axis.state() == canopen::DriveState::operation_enabled;
  return obeyed_[i] || takes_setpoint || d_.axes.confirmed_standing(i, now);
}

bool StopAssurance::in_reach_of_pdos(const Node& node, Instant now) const {
  return node.operational() && !node.pdos_doubtful &&
         std::ranges::all_of(
             d_.axes, [&](const Axis& axis) { return axis.node() != node.id || axis.fresh(now); });
}

void StopAssurance::send_by_sdo(Instant now, std::vector<CanFrame>& service) {
  if (!since_) return;
  if (!d_.commanding) d_.axes.command_stop(now);
  for (Node& node : d_.nodes) {
    if (!node.by_sdo || starves(node, now)) continue;
    node.stopper.tick(now, d_.axes.sdo_stop_words(), service);
    d_.axes.on_news(node.stopper.take_news(), now);
  }
}

bool StopAssurance::starves(const Node& node, Instant now) const {
  if (!withheld_since_ || !node.unconfirmed) return false;
  Duration longest{0};
  for (const WatchdogConfig& watchdog : d_.config.watchdogs) {
    if (watchdog.node != node.id) continue;
    if (watchdog.kind == WatchdogConfig::Kind::heartbeat_consumer) return false;
    longest = std::max<Duration>(longest, milliseconds(watchdog.timeout_ms));
  }
  return now - *withheld_since_ < longest + kWatchdogMargin;
}

bool StopAssurance::withholds() const { return std::ranges::any_of(d_.nodes, &Node::unconfirmed); }

std::string StopAssurance::text() const {
  std::string names;
  for (const Node& node : d_.nodes) {
    if (node.unconfirmed) names += (names.empty() ? "" : ", ") + node.name;
  }
  if (names.empty()) return names;
  return fmt::format(
      "{}: stop not confirmed within {:g} ms: heartbeat and setpoints are withheld, so that the "
      "drive's own watchdog stops it",
      names, to_milliseconds(confirmation_time()));
}

std::int64_t StopAssurance::stops_by_sdo() const {
  std::int64_t sum = 0;
  for (const Node& node : d_.nodes) sum += node.stopper.writes() + node.inquiry.writes();
  return sum;
}

}  // namespace tether::cia402
