#include <chrono>

#include "doors/link/node/config.hpp"
#include "tests/fuzz/fuzz.hpp"

namespace tether::fuzzing {

/// A file for tether-link; what is taken is within its limits, and its addresses read as they are
/// written.
void try_input(std::span<const std::uint8_t> input) {
  takes([&] {
    const link::LinkConfig c = link::parse_link_config(text_of(input), "/etc/tether/link.toml");
    must(!c.paths.empty() && c.paths.size() <= link::kMostPaths, "one path or two");
    must(c.settings.paths == c.paths.size(), "all know how many");
    must(!c.peers.empty() && c.peers.size() <= link::Endpoint::kMostPeers, "a peer at least");
    must(c.settings.datagram_bytes >= 548 && c.settings.datagram_bytes <= 65507, "packets fit IP");
    must(c.report_period >= std::chrono::milliseconds{100}, "reports leave time for others");
    must(!c.settings.second_after || *c.settings.second_after > Duration{0}, "copies come later");
    for (const link::PathConfig& path : c.paths) {
      must(link::address_from_text(link::to_text(path.bind)) == path.bind, "an address is one");
    }
    for (const link::PeerConfig& peer : c.peers) {
      must(peer.setup.addresses.size() <= c.paths.size(), "no address without a path");
      const auto name = peer.setup.rules.send.name_of("CTRL/CMD_VEL");
      (void)peer.setup.rules.receive.has(name.value_or("CTRL/CMD_VEL"));
      (void)peer.setup.rules.latest_only.has("AGV/POSE");
    }
  });
}

}  // namespace tether::fuzzing
