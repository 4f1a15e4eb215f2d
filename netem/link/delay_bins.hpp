#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace tether {

/// Delays sorted into bins, in bounded memory: below 2^kBits ns each has a bin of its own; above,
/// every power of two is cut into 2^(kBits−1), so that bins are at most 2^(1−kBits) of their value
/// wide. `Bin` is what the user keeps of the delays in one, with their number in `count`.
template <class Bin, int kBits>
class DelayBins {
 public:
  /// The bin of a delay of `ns` >= 0.
  Bin& of(std::int64_t ns) {
    const int width = static_cast<int>(std::bit_width(static_cast<std::uint64_t>(ns)));
    const int shift = std::max(0, width - kBits);
    std::vector<Bin>& octave = octaves_[static_cast<std::size_t>(shift)];
    if (octave.empty()) octave.resize(std::size_t{1} << kBits);
    return octave[static_cast<std::size_t>(ns >> shift)];
  }

  /// The bin that holds the delay number `rank` of all, 1 being the shortest.
  const Bin& of_rank(std::int64_t rank) const {
    assert(rank >= 1);
    const Bin* last = nullptr;
    std::int64_t up_to = 0;
    for (const auto& octave : octaves_) {
      for (const Bin& bin : octave) {
        if (bin.count == 0) continue;
        last = &bin;
        up_to += bin.count;
        if (up_to >= rank) return bin;
      }
    }
    assert(last && "no delays");
    return *last;
  }

 private:
  std::array<std::vector<Bin>, 64 - kBits> octaves_;  // none of the longest has the sign bit
};

}  // namespace tether
