#pragma once

#include <boost/random/uniform_01.hpp>
#include <cstdint>
#include <random>
#include <string_view>

namespace tether {

/// The engine of all random draws: its sequence is fixed by the C++ standard. Distributions come
/// from Boost.Random, because the standard's differ between libraries.
using RandomEngine = std::mt19937_64;

/// An independent stream for one purpose of a run, derived from the run's seed and a name such as
/// "AGV/uplink/loss". Adding a stream, or draws to one, changes no other.
RandomEngine random_stream(std::uint64_t seed, std::string_view name);

/// The next number of a uniform distribution on [0, 1).
inline double uniform_01(RandomEngine& random) {
  return boost::random::uniform_01<double>()(random);
}

}  // namespace tether
