#pragma once

#include <cstdint>
#include <span>

namespace tether {

/// Size and checksum of a message, by which its bytes are recognised.
struct MessageDigest {
  std::int64_t size = 0;
  std::uint32_t crc32 = 0;  ///< as zlib computes it

  friend bool operator==(const MessageDigest&, const MessageDigest&) = default;
};

MessageDigest digest_of(std::span<const std::uint8_t> bytes);

}  // namespace tether
