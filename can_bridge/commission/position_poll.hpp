#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "can_bridge/bus/can_frame.hpp"
#include "can_bridge/bus/sdo_upload.hpp"
#include "can_bridge/cia402/config.hpp"
#include "common/base/time.hpp"

namespace tether {

/// Follows a wheel by reading its position (0x6064) by SDO, because no TPDO comes without SYNC.
/// Pure.
class PositionPoll {
 public:
  /// A wheel stands that moves less than kStill_m, or one count, for kWindow.
  static constexpr Duration kWindow = std::chrono::milliseconds{200};
  static constexpr double kStill_m = 0.0005;

  PositionPoll(const AxisConfig& axis, double wheel_radius_m);

  void on_frame(const CanFrame& frame, Instant now);
  /// Appends one upload request at most.
  void tick(Instant now, std::vector<CanFrame>& out);

  /// Since when the wheel has stood; nullopt while it turns, or while that is not known.
  std::optional<Instant> stands_since(Instant now) const;
  /// Way since the first answer, forward positive, m.
  double way_m() const { return way_m_; }

 private:
  struct Sample {
    Instant stamp{};
    double way_m = 0.0;
  };

  AxisConfig axis_;
  double m_per_count_;
  std::optional<SdoUpload> pending_;
  std::optional<std::uint32_t> raw_;
  double way_m_ = 0.0;
  std::deque<Sample> samples_;
};

}  // namespace tether
