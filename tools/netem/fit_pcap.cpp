#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <map>
#include <optional>
#include <span>
#include <utility>

#include "common/base/errors.hpp"
#include "tools/netem/fit.hpp"

// Formats: pcap-savefile(5), www.tcpdump.org/linktypes.html, RFC 791, RFC 768, and LCM's UDP
// multicast protocol (lcm/lcm_udpm.c, udpm_util.h): magic "LC02" (whole messages) or "LC03"
// (fragments), u32 sequence number; fragments then have u32 message size, u32 offset, u16 fragment
// number and u16 number of fragments; all big endian.

namespace tether {
namespace {

using Bytes = std::span<const std::uint8_t>;

std::uint32_t big_endian(Bytes bytes, std::size_t offset, std::size_t size) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < size; ++i) value = value << 8 | bytes[offset + i];
  return value;
}

/// Numbers of the file's own header and of its records, in the byte order of who wrote it.
class PcapReader {
 public:
  PcapReader(std::istream& in, std::string name) : in_(in), name_(std::move(name)) {
    std::array<std::uint8_t, 24> header{};
    if (!read(header)) throw UsageError(fmt::format("{}: too short for a pcap file", name_));
    swapped_ = header[0] == 0xd4 || header[0] == 0x4d;      // little endian
    nanoseconds_ = header[1] == 0x3c || header[2] == 0x3c;  // 4d 3c b2 a1, a1 b2 3c 4d
    link_type = number(header, 20) & 0x0fffffffU;
  }

  /// Whether there is another record. A file that breaks off in a record ends before it.
  bool next(std::vector<std::uint8_t>& frame, double& time_s) {
    std::array<std::uint8_t, 16> header{};
    if (!read(header)) return false;
    const std::uint32_t size = number(header, 8);
    constexpr std::uint32_t kLargest = 262'144;  // tcpdump's own limit
    if (size > kLargest) {
      throw UsageError(fmt::format("{}: the record at byte {} claims {} bytes: damaged", name_,
                                   position_ - header.size(), size));
    }
    time_s = number(header, 0) + number(header, 4) * (nanoseconds_ ? 1e-9 : 1e-6);
    frame.resize(size);
    return read(frame);
  }

  std::uint32_t link_type = 0;

 private:
  bool read(std::span<std::uint8_t> bytes) {
    in_.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    position_ += bytes.size();
    return static_cast<std::size_t>(in_.gcount()) == bytes.size();
  }
  std::uint32_t number(Bytes bytes, std::size_t offset) const {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < 4; ++i) {
      value = value << 8 | bytes[offset + (swapped_ ? 3 - i : i)];
    }
    return value;
  }

  std::istream& in_;
  std::string name_;
  std::uint64_t position_ = 0;
  bool swapped_ = false;
  bool nanoseconds_ = false;
};

/// The IPv4 packet of a captured frame; empty if it is not IPv4.
Bytes ip_packet(Bytes frame, std::uint32_t link_type) {
  constexpr std::uint32_t kIpv4 = 0x0800, kVlan = 0x8100, kServiceVlan = 0x88a8;
  const auto after = [&](std::size_t header, std::size_t type_at) {
    if (frame.size() < header) return Bytes{};
    return big_endian(frame, type_at, 2) == kIpv4 ? frame.subspan(header) : Bytes{};
  };
  switch (link_type) {
    case 1: {  // Ethernet, with any number of VLAN tags
      std::size_t type_at = 12;
      while (frame.size() >= type_at + 6 && (big_endian(frame, type_at, 2) == kVlan ||
                                             big_endian(frame, type_at, 2) == kServiceVlan)) {
        type_at += 4;
      }
      return after(type_at + 2, type_at);
    }
    case 113:
      return after(16, 14);  // Linux cooked
    case 276:
      return after(20, 0);  // Linux cooked, version 2
    case 0:                 // BSD loopback
    case 108:
      return frame.size() > 4 ? frame.subspan(4) : Bytes{};
    case 12:  // raw IP, as some systems number it
    case 101:
    case 228:
      return frame;
    default:
      return {};
  }
}

struct LcmPacket {
  std::string sender;
  std::uint32_t seq = 0;
};

/// The message that a captured frame is, or begins.
std::optional<LcmPacket> lcm_packet(Bytes frame, std::uint32_t link_type) {
  constexpr std::uint32_t kWhole = 0x4c433032, kFragment = 0x4c433033, kUdp = 17;
  const Bytes ip = ip_packet(frame, link_type);
  if (ip.size() < 20 || ip[0] >> 4 != 4 || ip[9] != kUdp) return std::nullopt;
  const std::size_t header = static_cast<std::size_t>(ip[0] & 0x0f) * 4;
  const bool later_ip_fragment = (big_endian(ip, 6, 2) & 0x1fffU) != 0;
  if (later_ip_fragment || header < 20 || ip.size() < header + 8 + 8) return std::nullopt;
  const Bytes udp = ip.subspan(header), lcm = udp.subspan(8);
  const std::uint32_t magic = big_endian(lcm, 0, 4);
  if (magic == kFragment && (lcm.size() < 20 || big_endian(lcm, 16, 2) != 0)) return std::nullopt;
  if (magic != kWhole && magic != kFragment) return std::nullopt;
  return LcmPacket{
      fmt::format("{}.{}.{}.{}:{}", ip[12], ip[13], ip[14], ip[15], big_endian(udp, 0, 2)),
      big_endian(lcm, 4, 4)};
}

}  // namespace

FitInput read_fit_pcap(std::istream& in, const std::string& name, const std::string& sender) {
  PcapReader reader(in, name);
  constexpr std::array<std::uint32_t, 8> kLinkTypes{0, 1, 12, 101, 108, 113, 228, 276};
  if (std::find(kLinkTypes.begin(), kLinkTypes.end(), reader.link_type) == kLinkTypes.end()) {
    throw UsageError(fmt::format("{}: link type {} is not supported", name, reader.link_type));
  }
  constexpr std::size_t kMostSenders = 1000;
  std::map<std::string, std::vector<Reception>> senders;
  std::vector<std::uint8_t> frame;
  double time_s = 0.0;
  while (reader.next(frame, time_s)) {
    const auto packet = lcm_packet(frame, reader.link_type);
    if (!packet || (!sender.empty() && packet->sender != sender)) continue;
    if (senders.size() == kMostSenders && senders.count(packet->sender) == 0) continue;
    senders[packet->sender].push_back({packet->seq, time_s});
  }
  if (senders.empty()) {
    throw UsageError(fmt::format("{}: no LCM messages over UDP and IPv4{}", name,
                                 sender.empty() ? "" : " from " + sender));
  }
  if (senders.size() > 1) {
    std::vector<std::string> names;
    for (const auto& [label, receptions] : senders) {
      names.push_back(fmt::format("{} ({} messages)", label, receptions.size()));
    }
    throw UsageError(fmt::format("{} has several senders; choose one with --sender: {}", name,
                                 fmt::join(names, ", ")));
  }
  const auto& [chosen, receptions] = *senders.begin();
  return fit_input_from(receptions, fmt::format("{}, LCM messages from {}", name, chosen));
}

}  // namespace tether
