#include "netem/link/packet_models.hpp"

#include <algorithm>
#include <iterator>

namespace tether {
namespace {

RandomEngine engine_from(RandomEngine& random) { return RandomEngine{random()}; }

}  // namespace

bool Coin::toss() { return probability_ > 0.0 && uniform_01(random_) < probability_; }

// -------------------------------------------------------------------------------- corruption

Corruption::Corruption(const CorruptConfig& config, RandomEngine random)
    : bits_(config.bits), coin_(config.probability, engine_from(random)), where_(random) {}

Corruption::Damage Corruption::next() {
  const std::uint64_t where = where_();
  return {coin_.toss(), where};
}

bool Corruption::apply(const Damage& damage, std::vector<std::uint8_t>& bytes) const {
  const std::uint64_t total = 8 * bytes.size();
  if (!damage.any || total == 0) return false;
  const std::uint64_t wanted = std::min(total, static_cast<std::uint64_t>(bits_));
  // Floyd's sampling without replacement (Communications of the ACM 30(9), 1987).
  std::vector<bool> chosen(total);
  for (std::uint64_t i = total - wanted; i < total; ++i) {
    std::uint64_t bit = split_mix(damage.where + i) % (i + 1);
    if (chosen[bit]) bit = i;
    chosen[bit] = true;
    bytes[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
  }
  return true;
}

void Corruption::set(const CorruptConfig& config) {
  bits_ = config.bits;
  coin_.set(config.probability);
}

void Corruption::skip(std::int64_t packets) {
  coin_.skip(packets);
  where_.discard(static_cast<std::uint64_t>(packets));
}

// -------------------------------------------------------------------------------- reordering

Reordering::Reordering(const ReorderConfig& config, RandomEngine random)
    : gap_(config.gap), since_last_(0), coin_(config.probability, random) {}

bool Reordering::skips_delay() {
  const bool lucky = coin_.toss();
  ++since_last_;
  if (!lucky || since_last_ < gap_) return false;
  since_last_ = 0;
  return true;
}

void Reordering::set(const ReorderConfig& config) {
  gap_ = config.gap;
  coin_.set(config.probability);
}

// -------------------------------------------------------------------------------- rate

std::optional<Instant> RateLimit::pass(Instant now, std::size_t bytes) {
  while (!waiting_.empty() && waiting_.front().through <= now) {
    waiting_bytes_ -= waiting_.front().bytes;
    waiting_.pop_front();
  }
  const std::int64_t length = static_cast<std::int64_t>(bytes) + config_.overhead_bytes;
  if (static_cast<std::int64_t>(waiting_.size()) >= config_.queue_packets ||
      (config_.queue_bytes > 0 && waiting_bytes_ + length > config_.queue_bytes)) {
    return std::nullopt;
  }
  constexpr double kLongest_s = 1e6;
  const double seconds = 8.0 * static_cast<double>(length) / config_.bits_per_s;
  free_from_ = std::max(now, free_from_) + from_seconds(std::min(kLongest_s, seconds));
  waiting_.push_back({free_from_, length});
  waiting_bytes_ += length;
  return free_from_;
}

// -------------------------------------------------------------------------------- slots

SlotSchedule::SlotSchedule(const SlotConfig& config, RandomEngine random)
    : period_(std::max(Duration{1}, from_seconds(config.period_ms * 1e-3))),
      jitter_ns_(config.jitter_ms * 1e6),
      limit_(config.packets),
      seed_(random()) {}

Instant SlotSchedule::begin_of(std::int64_t slot) const {
  const double luck =
      static_cast<double>(split_mix(seed_ + static_cast<std::uint64_t>(slot)) >> 11);
  return kStart + slot * period_ +
         Duration{static_cast<Duration::rep>(luck * 0x1p-53 * jitter_ns_)};
}

std::int64_t SlotSchedule::first_from(Instant ready) const {
  // With jitter up to a period, only the slot before may still begin at or after `ready`.
  const Duration since = ready - kStart;
  std::int64_t slot = since / period_;
  if (slot * period_ > since) --slot;  // division rounds towards zero
  --slot;
  while (begin_of(slot) < ready) ++slot;
  return slot;
}

Instant SlotSchedule::place(Instant now, Instant ready) {
  std::int64_t slot = first_from(ready);
  if (limit_ == 0) return begin_of(slot);
  const std::int64_t past = first_from(now);
  used_.erase(used_.begin(), used_.lower_bound(past));
  while (!full_.empty() && full_.begin()->second < past) full_.erase(full_.begin());
  // Behind the run of full slots that holds this one, if any.
  const auto after = full_.upper_bound(slot);
  if (after != full_.begin() && std::prev(after)->second >= slot)
    slot = std::prev(after)->second + 1;
  if (++used_[slot] == limit_) {
    used_.erase(slot);
    std::int64_t first = slot, last = slot;
    const auto next = full_.upper_bound(slot);
    if (next != full_.begin() && std::prev(next)->second == slot - 1)
      first = std::prev(next)->first;
    if (next != full_.end() && next->first == slot + 1) {
      last = next->second;
      full_.erase(next);
    }
    full_[first] = last;
  }
  return begin_of(slot);
}

// -------------------------------------------------------------------------------- outages

OutageSchedule::OutageSchedule(const std::vector<std::vector<double>>& outages_s) {
  for (const auto& outage : outages_s) {
    outages_.push_back({kStart + from_seconds(outage[0]), kStart + from_seconds(outage[1])});
  }
}

bool OutageSchedule::out(Instant now) const {
  const auto next = std::upper_bound(outages_.begin(), outages_.end(), now,
                                     [](Instant t, const Outage& o) { return t < o.from; });
  return next != outages_.begin() && now < std::prev(next)->until;
}

}  // namespace tether
