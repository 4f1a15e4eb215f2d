#include "doors/link/path_fates.hpp"

#include <algorithm>
#include <utility>

namespace tether::link {

namespace {

/// No session lives this long; sums of counters stay in range.
constexpr std::uint64_t kMostCounter = std::uint64_t{1} << 62;

}  // namespace

void PathFates::begin(std::uint64_t generation, std::uint64_t counter) {
  generation_ = generation;
  deferred_ = false;
  base_ = counter;
  entries_.clear();
  for (Path& path : paths_) {
    path.settled = counter;
    path.sent = 0;
    path.marks.clear();
    path.last_sent_ns = 0;
    path.after_gap = true;
  }
}

PathFates::Entry* PathFates::entry(std::uint64_t counter) {
  if (counter < base_) return nullptr;
  if (counter - base_ >= kMostOpen) {
    begin(generation_, counter);
    for (Path& path : paths_) path.uncounted = true;
  }
  while (entries_.size() <= counter - base_) entries_.emplace_back();
  return &entries_[counter - base_];
}

void PathFates::on_received(std::size_t path, std::uint64_t generation, std::uint64_t counter,
                            std::int64_t sent_ns, std::int64_t transit_ns, bool own) {
  if (generation < generation_ || counter > kMostCounter) return;
  if (generation > generation_) {
    for (std::size_t p = 0; p < count_; ++p) settle_marks(p, Instant::max());
    begin(generation, 0);
  }
  Entry* const e = entry(counter);
  if (e == nullptr) return;
  e->sent_ns = sent_ns;
  e->transit_ns[path] = transit_ns;
  e->brought |= static_cast<std::uint8_t>(1U << path);
  if (own) e->only = static_cast<std::int8_t>(path);
}

void PathFates::on_probe(Instant now, std::size_t path, std::uint64_t generation,
                         std::uint64_t counter, std::uint64_t sent) {
  if (generation != generation_ || counter < path || counter > kMostCounter) return;
  for (std::size_t p = 0; p < count_; ++p) {
    if (Entry* const e = entry(counter - path + p)) e->only = static_cast<std::int8_t>(p);
  }
  Path& own = paths_[path];
  own.heard = now;
  own.ever_heard = true;
  if (own.uncounted) {
    own.uncounted = false;
    own.settled = std::max(own.settled, counter + 1);
    own.sent = sent;
  } else if (own.marks.empty() ? counter >= own.settled : counter > own.marks.back().counter) {
    own.marks.push_back({now, counter, sent});
  }
  for (std::size_t p = 0; p < count_; ++p) settle_marks(p, now);
  for (std::size_t p = 0; p < count_; ++p) settle_silent(p, now);
  forget_settled();
}

void PathFates::on_deferred(std::uint64_t generation) {
  if (generation == generation_) deferred_ = true;
}

void PathFates::settle_marks(std::size_t path, Instant now) {
  Path& own = paths_[path];
  while (!own.marks.empty() && now - own.marks.front().when >= kPatience) {
    const Mark mark = own.marks.front();
    own.marks.pop_front();
    settle(path, mark.counter + 1, mark.sent);
  }
}

void PathFates::settle_silent(std::size_t path, Instant now) {
  const Path& own = paths_[path];
  if (!follows(own) || !own.marks.empty() || now - own.heard < 2 * kPatience) return;
  for (std::size_t p = 0; p < count_; ++p) {
    const std::uint64_t known = paths_[p].settled;
    if (p != path && known > own.settled && known - base_ <= entries_.size()) {
      settle(path, known, std::nullopt);
    }
  }
}

bool PathFates::unseen(std::uint64_t counter) const {
  if (counter - base_ >= entries_.size()) return false;
  const Entry& e = entries_[counter - base_];
  return e.brought == 0 && e.only < 0;
}

std::vector<std::uint64_t> PathFates::missing(std::size_t path, std::uint64_t end,
                                              std::uint64_t& received) const {
  std::vector<std::uint64_t> counters;
  for (std::uint64_t c = paths_[path].settled; c < end; ++c) {
    const Entry& e = entries_[c - base_];
    if (e.only >= 0 && static_cast<std::size_t>(e.only) != path) continue;
    if ((e.brought >> path & 1U) != 0) {
      ++received;
    } else {
      counters.push_back(c);
    }
  }
  return counters;
}

void PathFates::settle(std::size_t path, std::uint64_t end, std::optional<std::uint64_t> sent) {
  Path& own = paths_[path];
  std::uint64_t received = 0;
  std::vector<std::uint64_t> lost = missing(path, end, received);
  const std::uint64_t total = sent.value_or(own.sent + received + lost.size()) - own.sent;
  // More are missing than were sent: a missing one may have been another path's PROBE, next
  // to ours, or its ACK.
  std::uint64_t excess = total < received + lost.size() ? received + lost.size() - total : 0;
  for (const int certainty : {0, 1, 2}) {
    std::erase_if(lost, [&](std::uint64_t c) {
      if (excess == 0 || (unseen(c) ? (unseen(c + 1) ? 0 : 1) : 2) != certainty) return false;
      --excess;
      return true;
    });
  }
  const std::int64_t end_ns = entries_[end - 1 - base_].sent_ns;
  auto next_lost = lost.begin();
  std::size_t unknown = 0;  // fates at the end whose time is not known yet
  std::vector<Fate> fates;
  const auto interpolate = [&](std::int64_t until_ns) {
    const std::size_t known = fates.size() - unknown;
    const std::int64_t from_ns = known > 0 ? fates[known - 1].sent_ns : own.last_sent_ns;
    for (std::size_t k = 0; k < unknown; ++k) {
      fates[known + k].sent_ns =
          from_ns == 0 ? until_ns
                       : from_ns + (until_ns - from_ns) / static_cast<std::int64_t>(unknown + 1) *
                                       static_cast<std::int64_t>(k + 1);
    }
    unknown = 0;
  };
  for (std::uint64_t c = own.settled; c < end; ++c) {
    const Entry& e = entries_[c - base_];
    const bool is_lost = next_lost != lost.end() && *next_lost == c;
    if (is_lost) ++next_lost;
    const bool arrived = (e.brought >> path & 1U) != 0;
    if (!is_lost && (!arrived || (e.only >= 0 && static_cast<std::size_t>(e.only) != path))) {
      continue;
    }
    if (e.brought != 0) interpolate(e.sent_ns);
    fates.push_back({e.sent_ns, is_lost ? std::nullopt : std::optional{e.transit_ns[path]}});
    if (e.brought == 0) ++unknown;
  }
  interpolate(end_ns);
  own.settled = end;
  own.sent += total;
  own.last_sent_ns = end_ns;
  if (deferred_ || total > received + lost.size()) {  // or it has sent what we cannot tell
    own.after_gap = true;
    return;
  }
  for (const Fate& fate : fates) add(own, fate);
}

void PathFates::add(Path& path, Fate fate) {
  fate.after_gap = std::exchange(path.after_gap, false);
  if (fate.after_gap) path.run = 0;
  if (!fate.transit_ns) {
    ++path.run;
  } else if (path.run > 0) {
    ++path.bursts.count;
    path.bursts.lost += path.run;
    path.bursts.longest = std::max(path.bursts.longest, path.run);
    path.run = 0;
  }
  if (path.fates.size() >= kMostFates) {  // take() is not called
    path.fates.clear();
    fate.after_gap = true;
  }
  path.fates.push_back(fate);
}

void PathFates::forget_settled() {
  std::uint64_t oldest = base_ + entries_.size();
  for (std::size_t p = 0; p < count_; ++p) {
    if (follows(paths_[p])) oldest = std::min(oldest, paths_[p].settled);
  }
  for (; base_ < oldest; ++base_) entries_.pop_front();
  for (std::size_t p = 0; p < count_; ++p) {
    if (!follows(paths_[p])) paths_[p].settled = std::max(paths_[p].settled, base_);
  }
}

std::vector<Fate> PathFates::take(std::size_t path) {
  return std::exchange(paths_[path].fates, {});
}

}  // namespace tether::link
