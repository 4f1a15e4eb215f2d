#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <string>

#include "tests/campaign/totals.hpp"
#include "tests/campaign/world.hpp"

namespace tether::campaign {

/// Many seeds, one after the other, on some threads.
struct Campaign {
  std::uint64_t first_seed = 1;
  std::uint64_t runs = 300;
  unsigned threads = 1;
};

/// Runs and checks them all; the same totals on any number of threads. `progress` hears now and
/// then, in the calling thread, how many have begun.
Totals run_campaign(const Setup& setup, const Campaign& campaign,
                    const std::function<void(std::uint64_t)>& progress = {});

/// Where in a drive a fault comes. Each phase is an instant of the drive without any fault, which
/// is the same up to there.
enum class Phase : std::uint8_t {
  starting,      ///< the drives are being configured
  disarmed,      ///< ready to be armed
  arming,        ///< power stages being switched on
  accelerating,  ///< a while after the wheels began to turn
  driving,       ///< at the speed that is wanted
  braking,       ///< on the ramp to zero, after DISARM
  standing,      ///< disarmed again
};
constexpr int kPhases = 7;

/// All single faults, or all pairs of fault kinds, in each phase; not drawn but enumerated.
/// Numbered from 0 on.
///
/// A pair's second fault comes 40 ms after the first, at the same drive or at the other one. Both
/// last as long as the middle of their row says. Vehicles with brakes and such that coast, and
/// controllers of twists and of plans, take turns from one number to the next.
class Enumeration {
 public:
  /// Runs the drives without faults once. `pairs`: else single faults.
  Enumeration(const Setup& setup, bool pairs);

  std::uint64_t size() const { return size_; }
  Trial trial(std::uint64_t number) const;
  /// "encoder frozen + bus-off while driving".
  std::string name(std::uint64_t number) const;

 private:
  struct Case {
    FaultKind first{};
    FaultKind second{};
    Phase phase{};
    bool same_node = true;
    bool coasts = false;
    bool plans = false;
  };
  Case at(std::uint64_t number) const;

  bool pairs_;
  std::uint64_t size_ = 0;
  /// When each phase is, by twists and by plans.
  std::array<std::array<Instant, kPhases>, 2> phases_{};
};

/// The numbers [0, enumeration.size()) on some threads.
Totals run_enumeration(const Setup& setup, const Enumeration& enumeration, unsigned threads);

}  // namespace tether::campaign
