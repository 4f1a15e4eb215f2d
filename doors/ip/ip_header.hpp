#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

namespace tether::ip {

/// An IPv4 address as a number: 10.67.0.1 is 0x0a430001.
using Address = std::uint32_t;

/// "10.67.0.1"
std::string to_text(Address address);

/// 224.0.0.0/4 and 255.255.255.255.
bool is_for_all(Address address);

struct IpHeader {
  Address source = 0;
  Address destination = 0;
};

/// Reads the header of an IPv4 packet as a TUN device hands it over; nullopt if `packet` is not
/// exactly one IPv4 packet: another version, a header that is too short, or a total length that is
/// not that of `packet`.
std::optional<IpHeader> read_ip_header(std::span<const std::uint8_t> packet);

}  // namespace tether::ip
