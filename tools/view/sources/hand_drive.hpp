#pragma once

#include <cstdint>
#include <optional>
#include <string_view>
#include <tether/clock_t.hpp>
#include <tether/pose_t.hpp>
#include <tether/twist_t.hpp>

#include "common/base/time.hpp"
#include "tools/view/session/hub.hpp"

namespace tether {

/// Manual driving: a page's twists are sent as the controller's, stamped as a controller would,
/// and so meet the network as a controller's do. One client drives at a time. Its page repeats each
/// twist as long as its dead man is held; when it falls silent, whatever the reason, zero twists
/// follow for a second, since the vehicle's actuator.policy may be to hold the last.
class HandDrive {
 public:
  /// A twist that is not repeated ends after this.
  static constexpr Duration kHold = std::chrono::milliseconds{250};
  static constexpr Duration kPeriod = std::chrono::milliseconds{50};  ///< period of tick()
  static constexpr double kFastest_mps = 10.0, kFastest_radps = 5.0;

  void hear(const clock_t& clock, Instant now);
  void hear(const pose_t& pose);

  /// Converts {"v_mps": 1, "omega_radps": 0}. Throws UsageError that says why there is none.
  twist_t take(ClientId client, std::string_view json, Instant now);
  /// A zero twist if one is due.
  std::optional<twist_t> tick(Instant now);

 private:
  static constexpr int kZeros = 20;

  twist_t stamped(double v_mps, double omega_radps, Instant now);
  bool is_held(Instant now) const { return driver_ && now - driven_at_ <= kHold; }

  std::optional<clock_t> clock_;
  Instant clock_at_{};
  std::int64_t pose_utime_ = -1;
  std::optional<ClientId> driver_;
  Instant driven_at_{};
  int zeros_ = 0;  ///< still to be sent
  std::int64_t seq_ = 0;
};

}  // namespace tether
