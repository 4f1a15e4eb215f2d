#include "doors/link/key_pair.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sodium.h>

namespace tether::link {

static_assert(crypto_kx_PUBLICKEYBYTES == sizeof(Key) && crypto_kx_SECRETKEYBYTES == sizeof(Key) &&
              crypto_kx_SEEDBYTES == sizeof(Key) && crypto_scalarmult_BYTES == sizeof(Key));

void wipe(Key& secret) { sodium_memzero(secret.data(), secret.size()); }

KeyPair key_pair_of(const Key& seed) {
  KeyPair pair;
  crypto_kx_seed_keypair(pair.public_key.data(), pair.secret_key.data(), seed.data());
  return pair;
}

KeyPair key_pair_with(const Key& secret_key) {
  KeyPair pair{{}, secret_key};
  crypto_scalarmult_base(pair.public_key.data(), secret_key.data());
  return pair;
}

std::string key_text(const Key& key) { return fmt::format("{:02x}", fmt::join(key, "")); }

std::optional<Key> key_from_text(std::string_view text) {
  Key key{};
  std::size_t length = 0;
  const char* end = nullptr;
  const bool is_hex =
      sodium_hex2bin(key.data(), key.size(), text.data(), text.size(), nullptr, &length, &end) == 0;
  if (!is_hex || length != key.size() || end != text.data() + text.size()) return std::nullopt;
  return key;
}

std::uint64_t key_id(const Key& public_key) {
  std::array<std::uint8_t, crypto_generichash_BYTES> hash{};
  crypto_generichash(hash.data(), hash.size(), public_key.data(), public_key.size(), nullptr, 0);
  return Reader(hash).number<std::uint64_t>();
}

}  // namespace tether::link
