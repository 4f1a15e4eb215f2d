#pragma once

#include <array>
#include <cstdint>

namespace tether::link {

/// Which counters have been seen, of the newest kSize (RFC 4303, 3.4.3; RFC 6479's ring of words).
class ReplayWindow {
 public:
  static constexpr std::uint64_t kSize = 2048;
  enum class Verdict : std::uint8_t { fresh, seen, too_old };

  Verdict look(std::uint64_t counter) const;
  /// Only of an authentic datagram: a forged counter would push all others out. Too old ones change
  /// nothing.
  void mark(std::uint64_t counter);

  /// Whether any has been marked, and the newest of them.
  bool any() const { return any_; }
  std::uint64_t newest() const { return newest_; }
  /// Bit i: newest() − i was marked.
  std::uint64_t newest_bits() const;

 private:
  static constexpr std::uint64_t kWordBits = 64;
  // One word more than the window, which is not aligned to words.
  static constexpr std::uint64_t kWords = kSize / kWordBits + 1;

  bool is_marked(std::uint64_t counter) const;

  std::array<std::uint64_t, kWords> words_{};
  std::uint64_t newest_ = 0;
  bool any_ = false;
};

}  // namespace tether::link
