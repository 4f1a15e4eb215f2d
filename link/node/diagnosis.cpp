#include "link/node/diagnosis.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace tether::link {

std::string Diagnosis::why_down(const Sight& sight) const {
  const Refusals& now = sight.refused;
  if (now.clock > then_.clock) {
    return fmt::format(
        "the clocks are {:+.1f} s apart, at most 60 s are allowed: set both (chrony, NTP); or "
        "somebody replays an old handshake",
        sight.clock_ahead_s);
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

std::optional<std::string> Diagnosis::look(Instant now, const Sight& sight) {
  std::string line;
  if (!sight.alive.empty()) {
    since_.reset();
    line = fmt::format("peer \"{}\": up, by {}", peer_, fmt::join(sight.alive, " and "));
    if (!sight.dead.empty()) line += fmt::format("; {} is down", fmt::join(sight.dead, ", "));
  } else {
    if (!since_) {
      since_ = now;
      then_ = sight.refused;
    }
    if (now - *since_ < kPatience) return std::nullopt;
    line = fmt::format("peer \"{}\": down: {}", peer_, why_down(sight));
    // Of the same cause, another number is no news.
    if (said_.substr(0, line.find_first_of("+-")) == line.substr(0, line.find_first_of("+-")) &&
        line.find("clocks") != std::string::npos) {
      return std::nullopt;
    }
  }
  if (line == said_) return std::nullopt;
  said_ = line;
  return line;
}

}  // namespace tether::link
