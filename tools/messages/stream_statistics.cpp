#include "tools/messages/stream_statistics.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <chrono>
#include <cmath>

#include "common/base/text.hpp"
#include "common/base/time.hpp"

namespace tether {
namespace {

constexpr Duration kRestartBehind = std::chrono::seconds{5};
constexpr std::int64_t kMaxAhead = 1'000'000;
constexpr std::size_t kMaxGaps = 4096;  // further ones stay missed for good

}  // namespace

void SequenceCounter::on_message(const MessageStamp& stamp) {
  if (stamp.seq < 0) {
    ++counters_.invalid;
  } else if (!any_) {
    start(stamp);
  } else if (stamp.seq > highest_.seq) {
    on_higher(stamp);
  } else {
    on_not_higher(stamp);
  }
}

void SequenceCounter::start(const MessageStamp& stamp) {
  any_ = true;
  highest_ = stamp;
  lowest_seq_ = stamp.seq;
  missing_.clear();
}

void SequenceCounter::on_higher(const MessageStamp& stamp) {
  const std::int64_t skipped = stamp.seq - highest_.seq - 1;
  if (skipped > kMaxAhead) {
    ++counters_.restarts;
    start(stamp);
    return;
  }
  if (skipped > 0) {
    counters_.missed += skipped;
    missing_[highest_.seq + 1] = stamp.seq - 1;
    if (missing_.size() > kMaxGaps) missing_.erase(missing_.begin());
  }
  highest_ = stamp;
}

void SequenceCounter::on_not_higher(const MessageStamp& stamp) {
  const Duration behind = from_utime(highest_.utime_us) - from_utime(stamp.utime_us);
  if (behind < Duration{0} || behind > kRestartBehind) {
    ++counters_.restarts;
    start(stamp);
  } else if (stamp.seq < lowest_seq_) {
    ++counters_.reordered;  // sent before the first one that arrived, so never missed
  } else if (take_missing(stamp.seq)) {
    --counters_.missed;
    ++counters_.reordered;
  } else {
    ++counters_.duplicated;
  }
}

bool SequenceCounter::take_missing(std::int64_t seq) {
  auto gap = missing_.upper_bound(seq);
  if (gap == missing_.begin()) return false;
  --gap;
  const auto [first, last] = *gap;
  if (seq > last) return false;
  missing_.erase(gap);
  if (first < seq) missing_[first] = seq - 1;
  if (seq < last) missing_[seq + 1] = last;
  return true;
}

void StreamStatistics::on_message(std::int64_t arrival_us, std::size_t size_bytes,
                                  const std::optional<MessageStamp>& stamp) {
  if (stamp) sequence_.on_message(*stamp);
  bytes_ += static_cast<std::int64_t>(size_bytes);
  if (count_++ == 0) {
    first_arrival_us_ = last_arrival_us_ = arrival_us;
    return;
  }
  const Duration interval = from_utime(arrival_us) - from_utime(last_arrival_us_);
  const std::int64_t interval_us = interval / std::chrono::microseconds{1};
  last_arrival_us_ = arrival_us;
  if (intervals_us_.size() < kMaxIntervals) {
    intervals_us_.push_back(interval_us);
  } else {
    intervals_us_[oldest_] = interval_us;
    oldest_ = (oldest_ + 1) % kMaxIntervals;
  }
}

StreamStatistics::Summary StreamStatistics::summary() const {
  Summary summary;
  summary.count = count_;
  summary.bytes = bytes_;
  summary.sequence = sequence_.counters();
  const double span_s = to_seconds(from_utime(last_arrival_us_) - from_utime(first_arrival_us_));
  if (count_ >= 2 && span_s > 0.0) {
    summary.rate_hz = static_cast<double>(count_ - 1) / span_s;
    summary.bandwidth_Bps =
        summary.rate_hz * static_cast<double>(bytes_) / static_cast<double>(count_);
  }
  if (intervals_us_.empty()) return summary;

  std::vector<double> milliseconds;
  milliseconds.reserve(intervals_us_.size());
  for (const std::int64_t us : intervals_us_) {
    milliseconds.push_back(static_cast<double>(us) * 1e-3);
  }
  std::sort(milliseconds.begin(), milliseconds.end());
  const double median = nearest_rank(milliseconds, 0.5);
  for (double& x : milliseconds) x = std::abs(x - median);
  std::sort(milliseconds.begin(), milliseconds.end());
  summary.median_interval_ms = median;
  summary.jitter = {nearest_rank(milliseconds, 0.5), nearest_rank(milliseconds, 0.9),
                    nearest_rank(milliseconds, 0.99), milliseconds.back()};
  return summary;
}

double nearest_rank(const std::vector<double>& sorted, double quantile) {
  assert(!sorted.empty());
  const double rank = std::ceil(quantile * static_cast<double>(sorted.size()));
  const auto index = static_cast<std::size_t>(std::max(rank, 1.0)) - 1;
  return sorted[std::min(index, sorted.size() - 1)];
}

void ChannelTable::on_message(std::string_view name, std::int64_t arrival_us,
                              const MessageContent& message) {
  auto found = channels_.find(name);
  if (found == channels_.end()) {
    if (channels_.size() >= kMaxChannels) {
      ++beyond_limit_;
      return;
    }
    found = channels_.emplace(name, Channel{}).first;
  }
  Channel& channel = found->second;
  std::string type = type_label(message);
  if (type != channel.type) {
    if (!channel.type.empty()) ++channel.type_changes;
    channel.type = std::move(type);
  }
  if (message.type != nullptr && !message.decoded()) ++channel.undecodable;

  std::optional<MessageStamp> stamp;
  const auto utime = message.integer("utime"), seq = message.integer("seq");
  if (utime && seq) stamp = MessageStamp{*utime, *seq};
  channel.statistics.on_message(arrival_us, message.size_bytes, stamp);
}

std::vector<std::string> ChannelTable::channels() const {
  std::vector<std::string> names;
  for (const auto& [name, unused] : channels_) names.push_back(name);
  return names;
}

std::int64_t ChannelTable::undecodable() const {
  std::int64_t sum = 0;
  for (const auto& [unused, channel] : channels_) sum += channel.undecodable;
  return sum;
}

std::string ChannelTable::format() const {
  std::size_t name_width = 7, type_width = 4;
  for (const auto& [name, channel] : channels_) {
    name_width = std::max(name_width, printable(name).size());
    type_width = std::max(type_width, channel.type.size());
  }
  const auto row = [&](const auto&... cells) {
    return fmt::format(
        "{:<{}}  {:<{}}  {:>8} {:>9} {:>7} {:>6} {:>6}  {:>8} {:>8} {:>8} {:>8} {:>9}\n", cells...);
  };
  constexpr std::size_t kBeforeJitter = 46;  // width of the columns between type and jitter
  std::string text =
      fmt::format("{:{}}jitter in ms:\n", "", name_width + type_width + kBeforeJitter);
  text += row("channel", name_width, "type", type_width, "count", "Hz", "missed", "dupl.", "reord.",
              "p50", "p90", "p99", "max", "kB/s");
  for (const auto& [name, channel] : channels_) {
    const StreamStatistics::Summary s = channel.statistics.summary();
    const auto ms = [](double x) { return fmt::format("{:.2f}", x); };
    text += row(printable(name), name_width, channel.type, type_width, s.count,
                fmt::format("{:.2f}", s.rate_hz), s.sequence.missed, s.sequence.duplicated,
                s.sequence.reordered, ms(s.jitter.p50_ms), ms(s.jitter.p90_ms), ms(s.jitter.p99_ms),
                ms(s.jitter.max_ms), fmt::format("{:.3f}", s.bandwidth_Bps * 1e-3));
  }
  return text + notes();
}

std::string ChannelTable::notes() const {
  std::string text;
  const auto note = [&text](std::string_view channel, std::int64_t count, const char* what) {
    if (count > 0) text += fmt::format("{}: {} {}\n", printable(channel), count, what);
  };
  for (const auto& [name, channel] : channels_) {
    const SequenceCounter::Counters& sequence = channel.statistics.sequence();
    note(name, channel.undecodable, "undecodable");
    note(name, channel.type_changes, "changes of type");
    note(name, sequence.restarts, "restarts of its publisher");
    note(name, sequence.invalid, "negative numbers");
  }
  if (beyond_limit_ > 0) {
    text += fmt::format("{} messages of channels beyond the first {} are not listed\n",
                        beyond_limit_, kMaxChannels);
  }
  return text;
}

}  // namespace tether
