#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "doors/link/wire.hpp"

namespace tether::link {

/// Overwrites a secret, which the compiler may not leave out.
void wipe(Key& secret);

/// A key pair of X25519. The secret key is wiped at the end.
struct KeyPair {
  ~KeyPair() { wipe(secret_key); }

  Key public_key{};
  Key secret_key{};
};

/// The pair that 32 random bytes make (libsodium's crypto_kx_seed_keypair). The seed determines the
/// secret key.
KeyPair key_pair_of(const Key& seed);

/// The pair of a secret key.
KeyPair key_pair_with(const Key& secret_key);

/// 64 hexadecimal digits, and back; nullopt if they are none.
std::string key_text(const Key& key);
std::optional<Key> key_from_text(std::string_view text);

/// Sender id in a HELLO: the first 8 bytes of BLAKE2b of the public key.
std::uint64_t key_id(const Key& public_key);

}  // namespace tether::link
