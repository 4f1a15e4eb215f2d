#include "link/node/diagnosis.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>

#include "link/session/sessions.hpp"

namespace tether::link {
namespace {

/// Clocks that drift or are measured anew are no news.
constexpr double kClockNews_s = 5.0;

}  // namespace

std::string Diagnosis::clocks_apart(double ahead_s) {
  if (std::abs(ahead_s - ahead_said_s_) > kClockNews_s) ahead_said_s_ = ahead_s;
  return fmt::format(
      "the clocks are {:+.1f} s apart, at most {:.0f} s are allowed: set both (chrony, NTP)",
      ahead_said_s_, to_seconds(Sessions::kMostClockDifference));
}

std::string Diagnosis::how_up(const Sight& sight) {
  std::string line = fmt::format("up, by {}", fmt::join(sight.alive, " and "));
  if (!sight.dead.empty()) line += fmt::format("; {} is down", fmt::join(sight.dead, ", "));
  if (!sight.narrow.empty()) {
    line += fmt::format("; {} does not carry packets of {} bytes: set a smaller mtu, on both hosts",
                        fmt::join(sight.narrow, ", "), sight.mtu);
  }
  if (std::abs(sight.clock_offset_s) > to_seconds(Sessions::kMostClockDifference)) {
    line += "; no new session can begin: " + clocks_apart(sight.clock_offset_s);
  }
  return line;
}

std::string Diagnosis::why_down(const Sight& sight) {
  const Refusals& now = sight.refused;
  if (now.clock > then_.clock) {
    return clocks_apart(sight.clock_ahead_s) + "; or somebody replays an old handshake";
  }
  if (now.version > then_.version) {
    return "datagrams of another version arrive: install the same Tether on both hosts";
  }
  if (now.address > then_.address) {
    return "its datagrams come from elsewhere than its `addresses` say: correct them, or leave "
           "\"\"";
  }
  if (now.crossed > then_.crossed) {
    return "its paths are in another order than ours: put [[path]] and addresses in the same one";
  }
  if (now.forged > then_.forged) {
    return "datagrams arrive that do not authenticate: compare each host's `tether link show` with "
           "public_key on the other";
  }
  if (now.stranger > then_.stranger) {
    return "a host with an unknown key calls: is the peer's key another now (`tether link show`)?";
  }
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
  if (!up && now - *since_ < kPatience) return std::nullopt;
  const std::string line = up ? how_up(sight) : "down: " + why_down(sight);
  if (line == said_) return std::nullopt;
  said_ = line;
  const bool well = up && line.find(';') == std::string::npos;
  return Line{well ? Severity::info : Severity::warning,
              fmt::format("peer \"{}\": {}", peer_, line)};
}

}  // namespace tether::link
