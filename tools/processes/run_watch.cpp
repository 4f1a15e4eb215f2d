#include "tools/processes/run_watch.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "common/base/text.hpp"
#include "common/bus/sole_sender.hpp"

namespace tether {
namespace {

/// Maximum number of reported findings; more would add nothing.
constexpr std::size_t kMaxFindings = 20;
/// More senders than a run has.
constexpr std::size_t kMostNamed = 10'000;

}  // namespace

std::string describe(const presence_t& presence) {
  return fmt::format("{} of {}, process {} on host {}", printable(presence.program),
                     printable(presence.vehicle), presence.pid, printable(presence.host));
}

void RunWatch::started(Instant now, const std::string& program, std::int64_t pid) {
  ended(program);
  const Duration starting = from_seconds(to_seconds(kPatience - kSilence) * rate_);
  own_[program] = {.pid = pid, .heard = std::max(now, kStart) + starting};
}

void RunWatch::ended(const std::string& program) {
  const auto own = own_.find(program);
  if (own == own_.end()) return;
  former_.push_back({program, own->second.pid, own->second.port});  // its last messages may come
  own_.erase(own);
}

void RunWatch::given_up(Instant now, const std::string& program) {
  find(now, program + " hangs: ending it");
  ended(program);
}

void RunWatch::sent(Instant now, const std::string& channel, std::uint64_t sender) {
  if (sender == 0 || named_.contains(sender) || unnamed_.size() >= kMaxFindings) return;
  unnamed_.try_emplace(sender, Unnamed{channel, now});
}

void RunWatch::sent_by_controller(Instant now, const std::string& channel, std::uint64_t sender) {
  if (sender == 0) return;
  const std::uint64_t first = controllers_.try_emplace(channel, sender).first->second;
  if (first == sender) return;
  find(now, fmt::format("{} and {} sent on {}, which belongs to one external controller",
                        sender_name(first), sender_name(sender), channel));
}

void RunWatch::judge_senders(Instant now, Instant since) {
  for (auto it = unnamed_.begin(); it != unnamed_.end();) {
    const auto& [sender, unnamed] = *it;
    if (unnamed.since > since) {
      ++it;
      continue;
    }
    find(now,
         fmt::format("an unknown program sent on {}: {}", unnamed.channel, sender_name(sender)));
    named_.insert(sender);
    it = unnamed_.erase(it);
  }
}

void RunWatch::late(const std::string& program, std::int64_t us_s) {
  if (!late_.contains(program) && late_.size() >= kMaxFindings) return;
  Late& late = late_[program];
  if (us_s < late.newest_us_s) late.before_us_s += late.newest_us_s;
  late.newest_us_s = us_s;
}

std::string RunWatch::lateness(Duration run) const {
  double sum_ms = 0.0, worst_ms = 0.0;
  std::string worst;
  for (const auto& [program, late] : late_) {
    const auto us_s = static_cast<double>(late.before_us_s) + static_cast<double>(late.newest_us_s);
    const double mean_ms = us_s * 1e-3 / std::max(to_seconds(run), 1e-3);
    sum_ms += mean_ms;
    if (mean_ms <= worst_ms) continue;
    worst_ms = mean_ms;
    worst = program;
  }
  if (sum_ms <= to_milliseconds(kMostLateness)) return "";
  return fmt::format(
      "the machine was too slow: late programs made messages {:.1f} ms older on "
      "average, {} alone {:.1f} ms; at most {} ms are allowed. Use --speed below 1 or "
      "end other work",
      sum_ms, printable(worst), worst_ms, to_milliseconds(kMostLateness));
}

void RunWatch::end(Instant now) { judge_senders(now, now); }

void RunWatch::name(std::uint64_t sender) {
  if (named_.size() < kMostNamed) named_.insert(sender);
  unnamed_.erase(sender);
}

void RunWatch::heard(Instant now, const presence_t& presence, std::uint64_t sender,
                     bool from_this_host) {
  if (presence.run != run_) {
    name(sender);
    return heard_of_other_run(now, presence);
  }
  const bool here = presence.host == host_ && from_this_host;
  const auto port = static_cast<std::uint16_t>(sender);
  const auto own = own_.find(presence.program);
  if (here && own != own_.end() && own->second.pid == presence.pid) {
    if (own->second.port == 0) own->second.port = port;
    if (own->second.port != port) {
      return find(now, fmt::format("{} says that it is {}, which sends from another port",
                                   sender_name(sender), describe(presence)));
    }
    own->second.heard = now;
    return name(sender);
  }
  const bool ended = std::any_of(former_.begin(), former_.end(), [&](const Former& f) {
    return f.program == presence.program && f.pid == presence.pid && f.port == port;
  });
  if (here && ended) return name(sender);
  if (own == own_.end()) return;  // its messages on the run's channels make it an unknown sender
  name(sender);
  has_unknown_senders_ = true;
  find(now, "a second " + describe(presence));
}

void RunWatch::heard_of_other_run(Instant now, const presence_t& presence) {
  has_unknown_senders_ = true;
  const auto known = std::find(other_runs_.begin(), other_runs_.end(), presence.run);
  if (known != other_runs_.end() || other_runs_.size() >= kMaxFindings) return;
  other_runs_.push_back(presence.run);
  find(now, "another run is on this network: " + describe(presence));
}

void RunWatch::several_senders(Instant now, const std::string& line) {
  if (!has_unknown_senders_) find(now, line);
}

void RunWatch::update(Instant now) {
  const bool was_suspended =
      updated_ && now - *updated_ > from_seconds(to_seconds(kSilence) * rate_);
  updated_ = now;
  if (was_suspended) {
    for (auto& [sender, unnamed] : unnamed_) unnamed.since = now;
  }
  judge_senders(now, now - from_seconds(to_seconds(kSilence) * rate_));
  for (auto& [program, own] : own_) {
    if (was_suspended) own.heard = std::max(own.heard, now);
    const bool hangs = silence(own, now) >= kSilence;
    if (hangs && !own.reported) find(now, program + " does not answer: stopped, hung or cut off");
    own.reported = hangs;
  }
}

Duration RunWatch::silence(const Own& own, Instant now) const {
  return from_seconds(to_seconds(now - own.heard) / rate_);
}

std::vector<std::pair<std::string, Duration>> RunWatch::hung(Instant now) const {
  std::vector<std::pair<std::string, Duration>> hung;
  for (const auto& [program, own] : own_) {
    if (own.reported) hung.emplace_back(program, silence(own, now));
  }
  return hung;
}

bool RunWatch::hangs(const std::string& program, Instant now, Duration for_so_long) const {
  const auto own = own_.find(program);
  return own != own_.end() && silence(own->second, now) >= for_so_long;
}

void RunWatch::find(Instant now, const std::string& what) {
  if (findings_.size() >= kMaxFindings ||
      std::find(known_.begin(), known_.end(), what) != known_.end()) {
    return;
  }
  known_.push_back(what);
  findings_.push_back(fmt::format("t = {:.1f} s: {}", to_seconds(now), what));
}

}  // namespace tether
