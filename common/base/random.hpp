#pragma once

#include <boost/random/uniform_01.hpp>
#include <boost/random/uniform_int_distribution.hpp>
#include <cstddef>
#include <cstdint>
#include <random>
#include <string_view>
#include <utility>
#include <vector>

namespace tether {

/// The engine of all random draws: its sequence is fixed by the C++ standard. Distributions come
/// from Boost.Random, because the standard's differ between libraries.
using RandomEngine = std::mt19937_64;

/// Finalizer of SplitMix64 (Steele, Lea, Flood, OOPSLA 2014): turns numbers that follow each other
/// into numbers that have nothing to do with each other.
constexpr std::uint64_t split_mix(std::uint64_t z) {
  z += 0x9e3779b97f4a7c15ULL;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

/// An independent stream for one purpose of a run, derived from the run's seed and a name such as
/// "AGV/uplink/loss". Adding a stream, or draws to one, changes no other.
RandomEngine random_stream(std::uint64_t seed, std::string_view name);

/// The next number of a uniform distribution on [0, 1).
inline double uniform_01(RandomEngine& random) {
  return boost::random::uniform_01<double>()(random);
}

/// Any order is as likely as any other (Fisher and Yates); the same with every standard library.
template <class One>
void shuffle(std::vector<One>& all, RandomEngine& random) {
  for (std::size_t i = all.size(); i > 1; --i) {
    boost::random::uniform_int_distribution<std::size_t> any(0, i - 1);
    std::swap(all[i - 1], all[any(random)]);
  }
}

}  // namespace tether
