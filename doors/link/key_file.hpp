#pragma once

#include <string>

#include "doors/link/key_pair.hpp"

namespace tether::link {

/// A key file has three lines:
///
///     # Key of tether-link: keep it secret. Others need the public key only.
///     secret_key = "<64 hexadecimal digits>"
///     public_key = "<64 hexadecimal digits>"
///
/// Writes one of mode 0600. Throws UsageError if `file` exists already, which is never overwritten,
/// or cannot be written.
void write_key_file(const std::string& file, const KeyPair& pair);

/// Throws UsageError that names file and remedy: if it cannot be read, if anybody but its owner may
/// read or write it, if it belongs to another user (except root), and if it holds no pair of keys.
KeyPair read_key_file(const std::string& file);

/// Throws UsageError if others than its owner may write a file that says whom to trust.
void check_only_owner_writes(const std::string& file);

}  // namespace tether::link
