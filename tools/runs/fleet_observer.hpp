#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "common/bus/bus.hpp"
#include "common/loop/event_loop.hpp"
#include "common/scenario/scenario.hpp"
#include "tools/runs/run_observer.hpp"

namespace tether {

/// Watches all vehicles of a run.
class FleetObserver {
 public:
  /// `members`: of fleet_members().
  FleetObserver(const std::vector<Scenario>& members, EventLoop& loop, Bus& bus);

  const std::vector<const RunObserver*>& vehicles() const { return vehicles_; }
  const std::vector<std::string>& names() const { return names_; }
  const RunObserver& first() const { return *vehicles_.front(); }
  bool is_one() const { return vehicles_.size() == 1; }

  /// Counters of all vehicles; what has one name, together. What a program counts as a whole, once.
  std::map<std::string, std::int64_t> counters() const;

  /// Throws if a result is not a number: then it is invalid and has no summary.
  void check_finite() const;

  /// Throws if a vehicle got what is no command to it: numbers that are not finite, malformed
  /// bytes, plans without a policy that follows them. For runs in which only their controller can
  /// have sent that. And if a vehicle refused all that it got.
  void check_commands() const;
  /// Names a vehicle that refused all commands and plans that reached it, as those of another run
  /// or from the future, and why; "" if there is none.
  std::string refused_commands() const;
  /// Names the streams whose numbers jumped further than losses explain (StreamGuard); "" if there
  /// is none.
  std::string jumps() const;
  /// Names the streams whose numbers began again (StreamGuard), as they do when a sender restarts
  /// or another one sends in its name; "" if there is none.
  std::string restarts() const;
  /// Names the vehicles for which more poses or commands came out of the network than the relay
  /// has delivered by its last report: another program sent them, whatever their source address
  /// says. "" if there is none. After the end of the run, for all that was sent has come then.
  std::string surplus() const;

 private:
  /// "AGV: sim.command.jumped 1, …" for the counters of this kind that are not 0.
  std::string streams_with(const std::string& kind) const;

  std::vector<std::unique_ptr<const RunObserver>> observers_;
  std::vector<const RunObserver*> vehicles_;
  std::vector<std::string> names_;
  std::vector<bool> poses_come_from_relay_;  ///< by vehicle
};

}  // namespace tether
