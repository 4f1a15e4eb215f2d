#include "link/node/diagnosis.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "link/session/sessions.hpp"

namespace tether::link {
namespace {

/// Clocks that drift or are measured again are no news.
constexpr double kClockNews_s = 5.0;
/// Share of a bound that clocks must come back to.
constexpr double kBack = 0.8;
constexpr char kCrossed[] =
    "its paths are in another order than ours: put [[path]] and addresses in the same one";

}  // namespace

std::string Diagnosis::clocks_apart(double ahead_s) {
  if (std::abs(ahead_s - ahead_said_s_) > kClockNews_s) ahead_said_s_ = ahead_s;
  return fmt::format(
      "the clocks are {:+.1f} s apart, at most {:.0f} s are allowed: set both (chrony, NTP)",
      ahead_said_s_, to_seconds(Sessions::kMostClockDifference));
}

/// Empty if they do not. Neither noise about a bound nor a small change is news.
std::string Diagnosis::clocks_differ(const Sight& sight) {
  const double now_s = std::abs(sight.clock_offset_s);
  const double bound_s = std::min(sight.clock_warning_s, sight.clock_limit_s);
  const bool differ = now_s >= bound_s * (differ_said_s_ > 0.0 ? kBack : 1.0);
  if (!differ) {
    differ_said_s_ = 0.0;
    return "";
  }
  const bool said_too_far = differ_said_s_ >= sight.clock_limit_s;
  const bool too_far = now_s >= sight.clock_limit_s * (said_too_far ? kBack : 1.0);
  const double ratio = now_s / std::max(differ_said_s_, 1e-9);
  if (ratio > 2.0 || ratio < 0.5 || too_far != said_too_far) differ_said_s_ = now_s;
  return fmt::format("; the clocks are {:.0f} ms apart at least{}: set both (chrony, NTP)",
                     differ_said_s_ * 1e3,
                     too_far ? ", and messages for a time, such as plans, are refused" : "");
}

std::string Diagnosis::how_up(const Sight& sight) {
  std::string line = fmt::format("up, by {}", fmt::join(sight.alive, " and "));
  if (!sight.dead.empty()) line += fmt::format("; {} is down", fmt::join(sight.dead, ", "));
  if (sight.crossed) line += fmt::format("; {}", kCrossed);
  if (!sight.narrow.empty()) {
    line += fmt::format("; {} does not carry packets of {} bytes: set a smaller mtu, on both hosts",
                        fmt::join(sight.narrow, ", "), sight.mtu);
  }
  if (std::abs(sight.clock_offset_s) > to_seconds(Sessions::kMostClockDifference)) {
    line += fmt::format("; no new session can begin: {}", clocks_apart(sight.clock_offset_s));
  } else {
    line += clocks_differ(sight);
  }
  return line;
}

std::string Diagnosis::why_down(const Sight& sight) {
  const Refusals& now = sight.refused;
  // Authenticated traffic.
  if (now.clock > then_.clock) {
    return fmt::format("{}; or an old handshake is replayed", clocks_apart(sight.clock_ahead_s));
  }
  if (sight.crossed) return kCrossed;
  // Anybody may send these, so that they are a hint: what came most often.
  struct Hint {
    std::int64_t count;
    const char* text;
  };
  const std::array<Hint, 4> hints{
      {{now.forged - then_.forged,
        "keys differ: compare each host's `tether-link show` with public_key on the other"},
       {now.version - then_.version,
        "another version runs there: install the same Tether on both hosts"},
       {now.address - then_.address,
        "it sends from elsewhere than its `addresses` here say: correct them"},
       {now.unknown_key - then_.unknown_key,
        "its key is another now: compare its `tether-link show` with public_key here"}}};
  const auto most = std::max_element(
      hints.begin(), hints.end(), [](const Hint& a, const Hint& b) { return a.count < b.count; });
  if (most->count > 0) return fmt::format("nothing authentic arrives; perhaps {}", most->text);
  return "nothing arrives: is tether-link running there, are addresses, ports and firewalls right?";
}

std::optional<Diagnosis::Line> Diagnosis::look(Instant now, const Sight& sight) {
  const bool up = !sight.alive.empty();
  if (up) {
    since_.reset();
  } else if (!since_) {
    since_ = now;
    then_ = sight.refused;
  }
  was_up_ = was_up_ || up;
  if (!up && !was_up_ && now - *since_ < kPatience) return std::nullopt;
  const std::string line = up ? how_up(sight) : fmt::format("down: {}", why_down(sight));
  if (line == said_) return std::nullopt;
  said_ = line;
  const bool well = up && line.find(';') == std::string::npos;
  return Line{well ? Severity::info : Severity::warning,
              fmt::format("peer \"{}\": {}", peer_, line)};
}

}  // namespace tether::link
