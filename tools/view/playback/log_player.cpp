#include "tools/view/playback/log_player.hpp"

#include <numeric>

namespace tether {
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
