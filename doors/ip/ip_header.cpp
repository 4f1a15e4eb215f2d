#include "doors/ip/ip_header.hpp"

#include <fmt/format.h>

namespace tether::ip {
namespace {

constexpr std::size_t kShortestHeader = 20;

Address address_at(std::span<const std::uint8_t> packet, std::size_t at) {
  return Address{packet[at]} << 24U | Address{packet[at + 1]} << 16U |
         Address{packet[at + 2]} << 8U | Address{packet[at + 3]};
}

}  // namespace

std::string to_text(Address address) {
  return fmt::format("{}.{}.{}.{}", address >> 24U, address >> 16U & 255U, address >> 8U & 255U,
                     address & 255U);
}

bool is_for_all(Address address) { return address >> 28U == 14U || address == 0xffffffffU; }

std::optional<IpHeader> read_ip_header(std::span<const std::uint8_t> packet) {
  if (packet.size() < kShortestHeader || packet[0] >> 4U != 4) return std::nullopt;
  const std::size_t header = (packet[0] & 15U) * std::size_t{4};
  const std::size_t total = packet[2] * std::size_t{256} + packet[3];
  if (header < kShortestHeader || header > total || total != packet.size()) return std::nullopt;
  return IpHeader{address_at(packet, 12), address_at(packet, 16)};
}

}  // namespace tether::ip
