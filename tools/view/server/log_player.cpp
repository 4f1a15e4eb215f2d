#include "tools/view/server/log_player.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>

#include "common/base/errors.hpp"

namespace tether {

LogIndex::LogIndex(EventLogReader& log, const std::string& name, std::size_t most_entries) {
  std::map<std::string, std::uint32_t> numbers;
  LoggedEvent event;
  while (log.next(event)) {
    if (entries_.size() == most_entries) {
      throw UsageError(
          fmt::format("{}: has more than {} events, too many to be played", name, most_entries));
    }
    const auto next = static_cast<std::uint32_t>(channels_.size());
    const auto [channel, is_new] = numbers.emplace(event.channel, next);
    if (is_new) channels_.push_back(event.channel);
    entries_.push_back({from_utime(event.timestamp_us), log.offset_bytes() - event.data.size(),
                        static_cast<std::uint32_t>(event.data.size()), channel->second});
  }
  std::stable_sort(entries_.begin(), entries_.end(),
                   [](const Entry& a, const Entry& b) { return a.time < b.time; });
  places_.resize(channels_.size());
  for (std::size_t i = 0; i < entries_.size(); ++i) {
    places_[entries_[i].channel].push_back(static_cast<std::uint32_t>(i));
  }
}

std::size_t LogIndex::count_until(Instant time) const {
  const auto later = std::upper_bound(entries_.begin(), entries_.end(), time,
                                      [](Instant t, const Entry& entry) { return t < entry.time; });
  return static_cast<std::size_t>(later - entries_.begin());
}

std::vector<std::size_t> LogIndex::latest(std::size_t begin, std::size_t end) const {
  std::vector<std::size_t> found;
  for (const std::vector<std::uint32_t>& places : places_) {
    const auto beyond = std::lower_bound(places.begin(), places.end(), end);
    if (beyond != places.begin() && *(beyond - 1) >= begin) found.push_back(*(beyond - 1));
  }
  std::sort(found.begin(), found.end());
  return found;
}

namespace {

Playback whole(const LogIndex& index) {
  const auto& entries = index.entries();
  if (entries.empty()) return {kStart, kStart};
  return {entries.front().time, entries.back().time};
}

}  // namespace

LogPlayer::LogPlayer(const LogIndex& index) : index_(index), playback_(whole(index)) {}

void LogPlayer::play(Instant now) {
  const bool from_the_start = playback_.position(now) == playback_.end();
  playback_.play(now);
  if (from_the_start) jumped_ = true;
}

void LogPlayer::seek(Instant now, Instant position) {
  playback_.seek(now, position);
  jumped_ = true;
}

std::vector<std::size_t> LogPlayer::due(Instant now) {
  const std::size_t end = index_.count_until(playback_.position(now));
  const std::size_t begin = jumped_ ? 0 : next_;
  const bool only_latest = jumped_ || end - begin > kMostAtOnce;
  next_ = end;
  jumped_ = false;
  if (only_latest) return index_.latest(begin, end);
  std::vector<std::size_t> all(end - begin);
  std::iota(all.begin(), all.end(), begin);
  return all;
}

}  // namespace tether
