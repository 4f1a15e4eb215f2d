#include "common/lcm/message_digest.hpp"

#include <sodium.h>

#include <stdexcept>

namespace tether {
namespace {

template <std::size_t size>
std::optional<std::array<std::uint8_t, size>> bytes_of_hex(const std::string& hex) {
  std::array<std::uint8_t, size> bytes{};
  std::size_t length = 0;
  const char* end = nullptr;
  const bool good =
      hex.size() == 2 * size &&
      sodium_hex2bin(bytes.data(), size, hex.data(), hex.size(), nullptr, &length, &end) == 0 &&
      length == size;
  return good ? std::optional(bytes) : std::nullopt;
}

}  // namespace

DigestKey random_digest_key() {
  if (sodium_init() < 0) throw std::runtime_error("libsodium does not start");
  DigestKey key{};
  randombytes_buf(key.data(), key.size());
  return key;
}

MessageDigest digest_of(std::span<const std::uint8_t> bytes, const DigestKey& key) {
  MessageDigest digest{.size = static_cast<std::int64_t>(bytes.size())};
  crypto_generichash(digest.hash.data(), digest.hash.size(), bytes.data(), bytes.size(), key.data(),
                     key.size());
  return digest;
}

std::string to_hex(std::span<const std::uint8_t> bytes) {
  std::string hex(2 * bytes.size() + 1, '\0');
  sodium_bin2hex(hex.data(), hex.size(), bytes.data(), bytes.size());
  hex.pop_back();
  return hex;
}

std::optional<DigestKey> key_of_hex(const std::string& hex) {
  return bytes_of_hex<DigestKey{}.size()>(hex);
}

MessageDigest digest_of_hex(std::int64_t size, const std::string& hash) {
  constexpr std::size_t kBytes = MessageDigest{}.hash.size();
  return {size, bytes_of_hex<kBytes>(hash).value_or(std::array<std::uint8_t, kBytes>{})};
}

}  // namespace tether
