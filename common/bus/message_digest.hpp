#pragma once

#include <cstdint>
#include <span>

namespace tether {

/// What tells a message's bytes from others.
struct MessageDigest {
  std::int64_t size = 0;
  std::uint32_t crc32 = 0;  ///< as zlib computes it

  friend bool operator==(const MessageDigest&, const MessageDigest&) = default;
};

MessageDigest digest_of(std::span<const std::uint8_t> bytes);

}  // namespace tether
