#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/time.hpp"
#include "doors/link/key_pair.hpp"
#include "doors/link/peer_link.hpp"

namespace tether::link {

/// Bytes of the headers in each IP packet of the network's `mtu`.
inline constexpr std::size_t kIpAndUdpBytes = 28;

/// One way into the network.
struct PathConfig {
  std::string name;
  Address bind;           ///< 0.0.0.0: any of this host's addresses
  std::string interface;  ///< "": whichever the routes say
};

struct PeerConfig {
  std::string name;
  PeerSetup setup;
};

/// Configuration of tether-link, read from a file:
///
///     key = "control.key"       # ours; beside this file, unless it begins with /
///     lcm_url = "udpm://239.255.76.67:7667?ttl=0"
///     mtu = 1400                # bytes of an IP packet that all paths carry, 576 to 65535
///     second_path = "always"    # each message by both paths at once; or "deferred": by the second
///     second_after_ms = 20      #   if the first is not acknowledged within this time, 1 to 1000
///     rekey_s = 3600            # 10 to 86400
///     report_period_s = 1       # 0.1 to 60
///     clock_warning_ms = 50     # difference of the clocks that is warned of, 1 to 60000
///     clock_limit_ms = 200      # and from which on `timed` messages are not taken, 1 to 60000
///
///     [[path]]                  # one or two, in the same order on both hosts
///     name = "wifi"
///     bind = "0.0.0.0:7700"
///     interface = "wlan0"       # optional; needs CAP_NET_RAW on old kernels
///
///     [[peer]]                  # each other host
///     name = "vehicle7"
///     public_key = "<64 hexadecimal digits>"
///     addresses = ["192.0.2.7:7700", ""]     # by path; "": learned from its datagrams
///     send = ["CTRL/(CMD_VEL|PLAN) -> AGV/$1"]
///     receive = ["AGV/.*"]      # by the names that it sends
///     latest_only = [".*/(POSE|CMD_VEL)"]
///     timed = [".*/(PLAN|PRELOAD)"]          # messages for a time, by the names that it sends
struct LinkConfig {
  std::string file;
  std::string key_file;
  std::string lcm_url;
  std::vector<PathConfig> paths;
  std::vector<PeerConfig> peers;
  LinkSettings settings;
  Duration report_period = std::chrono::seconds{1};
  Duration clock_warning = std::chrono::milliseconds{50};

  std::vector<PeerSetup> setups() const;
};

/// Throws UsageError that names file, line and key. Refuses a file that others may write.
LinkConfig load_link_config(const std::string& file);
LinkConfig parse_link_config(const std::string& text, const std::string& file);

/// "192.0.2.7:7700"; throws UsageError that says what is wrong.
Address address_from_text(const std::string& text);
std::string to_text(const Address& address);

}  // namespace tether::link
