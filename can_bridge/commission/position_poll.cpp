#include "can_bridge/commission/position_poll.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "can_bridge/bus/canopen.hpp"

namespace tether {
namespace {

constexpr Duration kTimeout = std::chrono::milliseconds{100};
constexpr std::size_t kMostSamples = 400;

}  // namespace

PositionPoll::PositionPoll(const AxisConfig& axis, double wheel_radius_m)
    : axis_(axis),
      m_per_count_(axis.sign * 2.0 * std::numbers::pi * wheel_radius_m /
                   axis.counts_per_revolution.value()) {}

void PositionPoll::on_frame(const CanFrame& frame, Instant now) {
  if (!pending_ || frame.id != canopen::kSdoResponse + axis_.node) return;
  pending_->on_frame(frame);
  const auto& result = pending_->result();
  if (!result || result->outcome != SdoUpload::Result::Outcome::done) return;
  if (result->bytes.size() < axis_.actual_position.bytes) return;
  const auto raw = static_cast<std::uint32_t>(canopen::read_integer(
      result->bytes.data(), axis_.actual_position.bytes, axis_.actual_position.is_signed));
  if (raw_) way_m_ += static_cast<std::int32_t>(raw - *raw_) * m_per_count_;
  raw_ = raw;
  samples_.push_back({now, way_m_});
  if (samples_.size() > kMostSamples) samples_.pop_front();
}

void PositionPoll::tick(Instant now, std::vector<CanFrame>& out) {
  if (pending_ && pending_->result()) pending_.reset();
  if (!pending_) {
    pending_.emplace(axis_.node, axis_.actual_position.index, axis_.actual_position.sub, kTimeout,
                     0);
  }
  pending_->tick(now, out);
}

std::optional<Instant> PositionPoll::stands_since(Instant now) const {
  if (samples_.empty() || now - samples_.back().stamp > kWindow / 2) return std::nullopt;
  const double still_m = std::max(kStill_m, std::abs(m_per_count_));
  Instant since = samples_.back().stamp;
  for (auto sample = samples_.rbegin(); sample != samples_.rend(); ++sample) {
    if (std::abs(sample->way_m - way_m_) > still_m) break;
    since = sample->stamp;
  }
  if (samples_.back().stamp - since < kWindow) return std::nullopt;
  return since;
}

}  // namespace tether
