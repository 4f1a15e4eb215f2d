#include "common/base/random.hpp"

#include "common/base/fnv1a.hpp"

namespace tether {
namespace {

// Finalizer of SplitMix64 (Steele, Lea, Flood, OOPSLA 2014): spreads nearby seeds apart.
std::uint64_t mix(std::uint64_t z) {
  z += 0x9e3779b97f4a7c15ULL;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

}  // namespace

RandomEngine random_stream(std::uint64_t seed, std::string_view name) {
  return RandomEngine{mix(mix(seed) ^ fnv1a(name))};
}

}  // namespace tether
