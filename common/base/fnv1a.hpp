#pragma once

#include <cstdint>
#include <string_view>

namespace tether {

/// FNV-1a, 64 bit (Fowler, Noll, Vo; draft-eastlake-fnv): tells whether bytes are the same, not who
/// made them.
constexpr std::uint64_t fnv1a(std::string_view bytes) {
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  for (const char c : bytes) {
    hash ^= static_cast<unsigned char>(c);
    hash *= 0x100000001b3ULL;
  }
  return hash;
}

}  // namespace tether
