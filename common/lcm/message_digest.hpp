#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace tether {

/// Secret of a run in lockstep, by which digests are made.
using DigestKey = std::array<std::uint8_t, 32>;
DigestKey random_digest_key();

/// Size and keyed BLAKE2b (RFC 7693) of a message, by which its bytes are recognised.
struct MessageDigest {
  std::int64_t size = 0;
  std::array<std::uint8_t, 16> hash{};

  friend bool operator==(const MessageDigest&, const MessageDigest&) = default;
};

MessageDigest digest_of(std::span<const std::uint8_t> bytes, const DigestKey& key);

/// Lower-case hexadecimal digits, as the protocol's messages have hashes and keys.
std::string to_hex(std::span<const std::uint8_t> bytes);
/// nullopt: anything else.
std::optional<DigestKey> key_of_hex(const std::string& hex);
/// All zeros for anything else, which no message's digest is.
MessageDigest digest_of_hex(std::int64_t size, const std::string& hash);

/// Value of the field `mac` of a protocol message: the digest of the rest but for `seq`, which
/// differs between copies of one message.
template <class LcmType>
std::string mac_of(LcmType message, const DigestKey& key) {
  message.seq = 0;
  message.mac.clear();
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return to_hex(digest_of(bytes, key).hash);
}

}  // namespace tether
