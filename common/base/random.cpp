#include "common/base/random.hpp"

#include "common/base/fnv1a.hpp"

namespace tether {

RandomEngine random_stream(std::uint64_t seed, std::string_view name) {
  return RandomEngine{split_mix(split_mix(seed) ^ fnv1a(name))};
}

}  // namespace tether
