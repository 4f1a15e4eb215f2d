#include "netem/medium/contention.hpp"

#include <algorithm>
#include <boost/random/uniform_int_distribution.hpp>
#include <cassert>
#include <limits>

namespace tether {
namespace {

constexpr std::int32_t kNever = std::numeric_limits<std::int32_t>::max();

/// [0, 1), from the upper 53 bits.
double uniform_of(std::uint64_t bits) { return static_cast<double>(bits >> 11) * 0x1p-53; }

}  // namespace

Contention::Contention(const ContentionRules& rules, std::uint64_t seed, Ended ended)
    : rules_(rules), seed_(seed), ended_(std::move(ended)), first_(kNever) {
  assert(rules.slot > Duration{0});
}

std::size_t Contention::add(int station, const AccessParameters& access, const QueueLimits& limits,
                            const std::string& name) {
  contenders_.push_back({.station = station,
                         .access = access,
                         .cw = access.cw_min,
                         .queue = FrameQueue(limits),
                         .endless = {},
                         .backoff = random_stream(seed_, name),
                         .noise = random_stream(seed_, name + "/noise")});
  zero_at_.push_back(access.aifsn);
  goes_at_.push_back(kNever);
  aifsn_.push_back(access.aifsn);
  untouched_.push_back(1);
  return contenders_.size() - 1;
}

void Contention::catch_up(Instant now) {
  while (next_event() < now) transmit(first_);
}

bool Contention::push(Instant now, std::size_t contender, const FrameQueue::Waiting& waiting) {
  catch_up(now);
  Contender& c = contenders_[contender];
  const bool waited = has_frame(c);
  if (!c.queue.push(waiting.since, waiting.frame)) {
    ++counters_.overflowed;
    return false;
  }
  if (!waited) join(now, contender);
  return true;
}

std::vector<FrameQueue::Waiting> Contention::take(Instant now, std::size_t contender, int station) {
  catch_up(now);
  Contender& c = contenders_[contender];
  if (!c.queue.empty() && c.queue.front().station == station) {
    c.attempts = 0;
    c.cw = c.access.cw_min;
  }
  std::vector<FrameQueue::Waiting> taken = c.queue.take(station);
  show(contender);
  first_ = *std::min_element(goes_at_.begin(), goes_at_.end());
  return taken;
}

void Contention::saturate(Instant now, std::size_t contender, const Frame& frame) {
  catch_up(now);
  const bool waited = has_frame(contenders_[contender]);
  contenders_[contender].endless = frame;
  if (!waited) join(now, contender);
}

Instant Contention::next_event() const {
  return first_ == kNever ? Instant::max() : boundary(first_);
}

void Contention::advance(Instant now) {
  while (next_event() <= now) transmit(first_);
}

/// A new counter, from the present contention window.
void Contention::draw(std::size_t i) {
  Contender& c = contenders_[i];
  zero_at_[i] = aifsn_[i] + boost::random::uniform_int_distribution<int>(0, c.cw)(c.backoff);
  untouched_[i] = 0;
}

void Contention::show(std::size_t i) {
  goes_at_[i] = has_frame(contenders_[i]) ? zero_at_[i] : kNever;
}

/// The first frame of an empty queue.
void Contention::join(Instant now, std::size_t i) {
  if (now < idle_since_ && untouched_[i] != 0) {
    draw(i);  // the medium is busy
  } else if (now > boundary(zero_at_[i])) {
    const Duration since = now - idle_since_ - rules_.sifs;
    zero_at_[i] = static_cast<std::int32_t>((since + rules_.slot - Duration{1}) / rules_.slot);
    untouched_[i] = 1;
  }
  show(i);
  first_ = std::min(first_, goes_at_[i]);
}

void Contention::transmit(std::int32_t slot) {
  const Instant start = boundary(slot);
  sending_.clear();
  for (std::size_t i = 0; i < goes_at_.size(); ++i) {
    if (goes_at_[i] != slot) continue;
    sending_.push_back(i);
    goes_at_[i] = kNever;  // until it draws again
  }
  freeze(slot);
  put_on_air();
  const bool collides = in_air_.size() > 1;
  Duration busy{0};
  std::size_t next = 0;
  for (const std::size_t i : sending_) {
    if (next == in_air_.size() || in_air_[next] != i) {
      fail(i, start, false);
      continue;
    }
    const Frame& frame = front(contenders_[i]);
    const double error_ratio = collides ? errors_among(next) : frame.error_ratio;
    ++next;
    const bool is_certain = collides && error_ratio >= 1.0;
    const bool lost =
        is_certain || (error_ratio > 0.0 && noise_of(contenders_[i], frame) < error_ratio);
    ++counters_.attempts;
    if (collides) ++counters_.collided;
    if (lost && !collides) ++counters_.corrupted;
    if (collides && !lost) ++counters_.captured;
    busy = std::max(busy, lost ? frame.wasted : frame.exchange);
    if (lost) {
      fail(i, start, true);
    } else {
      succeed(i, start);
    }
  }
  ++counters_.transmissions;
  if (collides) ++counters_.collisions;
  counters_.busy += busy;
  idle_since_ = start + busy;
  first_ = *std::min_element(goes_at_.begin(), goes_at_.end());
}

/// Who of those that send is in the air: of one station, only the most urgent.
void Contention::put_on_air() {
  in_air_.clear();
  frames_.clear();
  for (const std::size_t i : sending_) {
    const bool is_beaten = std::any_of(in_air_.begin(), in_air_.end(), [this, i](std::size_t j) {
      return contenders_[j].station == contenders_[i].station;
    });
    if (is_beaten) continue;
    in_air_.push_back(i);
    if (renew_) renew_(front(contenders_[i]));
  }
  if (!capture_ || in_air_.size() == 1) return;
  for (const std::size_t i : in_air_) frames_.push_back(front(contenders_[i]));
}

/// Uniform on [0, 1): the attempt fails if it is below the error ratio.
double Contention::noise_of(Contender& c, const Frame& frame) {
  if (!frame.luck) return uniform_01(c.noise);
  return uniform_of(split_mix(*frame.luck + static_cast<std::uint64_t>(c.attempts)));
}

/// Error probability of a frame that collides.
double Contention::errors_among(std::size_t which) const {
  return capture_ ? capture_(frames_, which) : 1.0;
}

/// The counters of all who do not transmit, as they are when the medium gets busy in `slot`.
void Contention::freeze(std::int32_t slot) {
  const std::int32_t passed =
      slot + (rules_.countdown == ContentionRules::Countdown::slot_boundaries ? 1 : 0);
  for (std::size_t i = 0; i < zero_at_.size(); ++i) {
    const std::int32_t counted = std::max(0, passed - aifsn_[i]);
    zero_at_[i] = std::max(aifsn_[i], zero_at_[i] - counted);
    if (goes_at_[i] != kNever) goes_at_[i] = zero_at_[i];
  }
  for (std::size_t i = 0; i < zero_at_.size(); ++i) {
    if (zero_at_[i] != aifsn_[i]) continue;
    if (goes_at_[i] == kNever) {
      untouched_[i] = 1;
    } else if (untouched_[i] != 0) {
      draw(i);  // it found the medium idle, but not for long enough
      show(i);
    }
  }
}

void Contention::succeed(std::size_t i, Instant start) {
  Contender& c = contenders_[i];
  const Frame& frame = front(c);
  ++counters_.delivered;
  ++c.delivered;
  if (!c.endless) ended_({frame.id, true, start + frame.air, c.attempts + 1});
  next_frame(i, start + frame.exchange);
}

void Contention::fail(std::size_t i, Instant start, bool was_sent) {
  Contender& c = contenders_[i];
  const Frame& frame = front(c);
  ++c.attempts;
  const bool is_last = c.access.attempts > 0 && c.attempts >= c.access.attempts;
  if ((was_sent && !frame.acknowledged) || is_last) {
    ++counters_.dropped;
    if (!c.endless) ended_({frame.id, false, start + frame.air, c.attempts});
    next_frame(i, start + frame.wasted);
    return;
  }
  c.cw = std::min(2 * c.cw + 1, c.access.cw_max);
  draw(i);
  show(i);
}

/// The next one in the queue that has not waited for too long, with the smallest window.
void Contention::next_frame(std::size_t i, Instant now) {
  Contender& c = contenders_[i];
  if (!c.endless) c.queue.pop();
  while (!c.endless && !c.queue.empty() && c.queue.front_expired(now)) {
    ++counters_.expired;
    ended_({c.queue.front().id, false, now, 0});
    c.queue.pop();
  }
  c.attempts = 0;
  c.cw = c.access.cw_min;
  draw(i);
  show(i);
}

}  // namespace tether
