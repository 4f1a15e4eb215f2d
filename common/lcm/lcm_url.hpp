#pragma once

#include <cstdint>
#include <string>

namespace tether {

/// Default LCM network: LCM's own multicast group and port, ttl=0, so nothing leaves the host.
inline constexpr char kDefaultLcmUrl[] = "udpm://239.255.76.67:7667?ttl=0";

/// Checks an LCM URL before LCM sees it, because LCM 1.3.1 crashes on a missing port and ignores
/// unknown options. Allowed: `udpm://GROUP:PORT[?ttl=N&recv_buf_size=N]` with an IPv4 multicast
/// group, and `tcpq://HOST:PORT`. Returns the URL, for udpm with `recv_buf_size=2097152` added if
/// absent (the kernel's default buffer overflows at a burst of some thousand messages).
/// Throws UsageError that names the offending part and what is allowed.
std::string checked_lcm_url(const std::string& url);

/// The multicast group of a checked udpm URL ("239.255.76.67"), empty for tcpq.
std::string multicast_group(const std::string& url);

/// The port of a checked URL.
std::uint16_t lcm_port(const std::string& url);

/// The same URL with the next port, for a run that needs its own network.
std::string with_next_port(const std::string& url);

/// "ttl" (0 if absent) or "recv_buf_size" of a checked udpm URL.
std::int64_t lcm_option(const std::string& url, const std::string& key);

}  // namespace tether
