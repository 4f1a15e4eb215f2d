#include "common/world/scan.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

namespace tether {
namespace {

/// Common fields of scan_t and scan_part_t.
template <class Message>
void say_how(const Scan& scan, std::int64_t run, Message& message) {
  message.utime = to_utime(scan.stamp);
  message.run = run;
  message.mount_x_m = scan.mount.x_m;
  message.mount_y_m = scan.mount.y_m;
  message.mount_yaw_rad = scan.mount.yaw_rad;
  message.angle_min_rad = scan.angle_min_rad;
  message.angle_increment_rad = scan.angle_increment_rad;
  message.time_increment_s = scan.time_increment_s;
  message.range_min_m = scan.range_min_m;
  message.range_max_m = scan.range_max_m;
  message.plan_session = scan.plan.session;
  message.plan_id = scan.plan.id;
}

/// A scan of that many beams without ranges; nullopt if that is not usable.
template <class Message>
std::optional<Scan> without_ranges(const Message& m, std::int64_t seq, std::int64_t beams) {
  const bool usable = beams >= 1 && beams <= scan_t::MAX_COUNT &&
                      is_usable(Pose2{m.mount_x_m, m.mount_y_m, m.mount_yaw_rad}) &&
                      is_usable(m.angle_min_rad) && is_usable(m.angle_increment_rad) &&
                      m.angle_increment_rad > 0.0 && m.time_increment_s >= 0.0 &&
                      m.time_increment_s * static_cast<double>(beams) <= to_seconds(kLongestScan) &&
                      is_usable(m.range_min_m) && m.range_min_m >= 0.0 &&
                      is_usable(m.range_max_m) && m.range_max_m >= m.range_min_m;
  if (!usable) return std::nullopt;
  Scan scan;
  scan.stamp = from_utime(m.utime);
  scan.seq = seq;
  scan.mount = {m.mount_x_m, m.mount_y_m, m.mount_yaw_rad};
  scan.angle_min_rad = m.angle_min_rad;
  scan.angle_increment_rad = m.angle_increment_rad;
  scan.time_increment_s = m.time_increment_s;
  scan.range_min_m = m.range_min_m;
  scan.range_max_m = m.range_max_m;
  scan.plan = {m.plan_session, m.plan_id};
  return scan;
}

std::optional<Scan> without_ranges(const scan_part_t& part) {
  const std::int64_t count = part.count;
  const bool usable = part.scan >= 0 && count >= 1 && part.range.size() == std::size_t(count) &&
                      part.first >= 0 && part.first + count <= std::int64_t{part.beams} &&
                      is_usable(part.range_step_m) && part.range_step_m > 0.0 &&
                      *std::min_element(part.range.begin(), part.range.end()) >= 0;
  if (!usable) return std::nullopt;
  return without_ranges(part, part.scan, part.beams);
}

std::int16_t steps(float range_m, double step_m) {
  if (!(range_m > 0.0F)) return 0;
  const double steps = std::max(std::round(static_cast<double>(range_m) / step_m), 1.0);
  return steps <= kMostRangeSteps ? static_cast<std::int16_t>(steps) : std::int16_t{0};
}

}  // namespace

scan_t scan_message(const Scan& scan, std::int64_t run) {
  scan_t message{};
  say_how(scan, run, message);
  message.seq = scan.seq;
  message.count = static_cast<std::int32_t>(scan.range_m.size());
  message.range_m = scan.range_m;
  return message;
}

std::optional<Scan> to_scan(const scan_t& message) {
  if (message.range_m.size() != static_cast<std::size_t>(std::max(message.count, 0)) ||
      !std::all_of(message.range_m.begin(), message.range_m.end(),
                   [](float r) { return r >= 0.0F && is_usable(static_cast<double>(r)); })) {
    return std::nullopt;
  }
  std::optional<Scan> scan = without_ranges(message, message.seq, message.count);
  if (scan) scan->range_m = message.range_m;
  return scan;
}

std::vector<scan_part_t> scan_parts(const Scan& scan, std::int64_t run, std::int64_t first_seq,
                                    std::size_t max_bytes, double step_m) {
  scan_part_t part{};
  say_how(scan, run, part);
  part.scan = scan.seq;
  part.beams = static_cast<std::int32_t>(scan.range_m.size());
  part.range_step_m = step_m;

  const auto overhead = static_cast<std::size_t>(part.getEncodedSize());
  const std::size_t room = (std::max(max_bytes, overhead) - overhead) / sizeof(std::int16_t);
  const std::size_t beams = scan.range_m.size(), most = std::max<std::size_t>(room, 1);
  const std::size_t count = (beams + most - 1) / most;
  std::vector<scan_part_t> parts;
  parts.reserve(count);
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t first = k * beams / count, end = (k + 1) * beams / count;
    part.seq = first_seq + static_cast<std::int64_t>(k);
    part.first = static_cast<std::int32_t>(first);
    part.count = static_cast<std::int32_t>(end - first);
    part.range.clear();
    for (std::size_t i = first; i < end; ++i) part.range.push_back(steps(scan.range_m[i], step_m));
    parts.push_back(part);
  }
  return parts;
}

/// Whether the unfinished scan is that of this part.
bool ScanAssembly::begun_by(const Scan& part) const {
  const auto how = [](const Scan& s) {
    return std::tuple(s.stamp, s.seq, s.mount.x_m, s.mount.y_m, s.mount.yaw_rad, s.angle_min_rad,
                      s.angle_increment_rad, s.time_increment_s, s.range_min_m, s.range_max_m,
                      s.plan.session, s.plan.id);
  };
  return pending_ && how(*pending_) == how(part);
}

std::optional<Scan> ScanAssembly::add(const scan_part_t& part) {
  std::optional<Scan> scan = without_ranges(part);
  if (!scan) {
    ++unusable_parts_;
    return std::nullopt;
  }
  if ((newest_done_ && scan->stamp <= *newest_done_) ||
      (pending_ && scan->stamp < pending_->stamp)) {
    ++late_parts_;
    return std::nullopt;
  }
  std::optional<Scan> ready;
  if (!pending_ || scan->stamp > pending_->stamp) {
    ready = take();
    pending_ = std::move(scan);
    missing_beams_ = static_cast<std::size_t>(part.beams);
    pending_->range_m.assign(missing_beams_, 0.0F);
    arrived_.assign(missing_beams_, false);
  } else if (!begun_by(*scan) || arrived_.size() != static_cast<std::size_t>(part.beams)) {
    ++unusable_parts_;
    return std::nullopt;
  }
  const std::size_t before = missing_beams_;
  for (std::size_t i = 0; i < part.range.size(); ++i) {
    const std::size_t beam = static_cast<std::size_t>(part.first) + i;
    if (arrived_[beam]) continue;
    arrived_[beam] = true;
    pending_->range_m[beam] = static_cast<float>(part.range_step_m * part.range[i]);
    --missing_beams_;
  }
  if (missing_beams_ == before) ++duplicated_parts_;
  if (missing_beams_ == 0 && !ready) ready = take();
  return ready;
}

std::optional<Instant> ScanAssembly::deadline() const {
  if (!pending_) return std::nullopt;
  return missing_beams_ == 0 ? pending_->stamp : pending_->end() + patience_;
}

std::optional<Scan> ScanAssembly::overdue(Instant now) {
  if (!pending_ || now < *deadline()) return std::nullopt;
  return take();
}

std::optional<Scan> ScanAssembly::take() {
  if (!pending_) return std::nullopt;
  ++(missing_beams_ == 0 ? complete_ : incomplete_);
  newest_done_ = pending_->stamp;
  return std::exchange(pending_, std::nullopt);
}

}  // namespace tether
