#include "link/session/replay_window.hpp"

#include <algorithm>

namespace tether::link {

bool ReplayWindow::is_marked(std::uint64_t counter) const {
  return (words_[counter / kWordBits % kWords] >> (counter % kWordBits) & 1) != 0;
}

ReplayWindow::Verdict ReplayWindow::look(std::uint64_t counter) const {
  if (!any_ || counter > newest_) return Verdict::fresh;
  if (newest_ - counter >= kSize) return Verdict::too_old;
  return is_marked(counter) ? Verdict::seen : Verdict::fresh;
}

void ReplayWindow::mark(std::uint64_t counter) {
  if (look(counter) == Verdict::too_old) return;
  if (!any_ || counter > newest_) {
    const std::uint64_t from = any_ ? newest_ / kWordBits : counter / kWordBits;
    const std::uint64_t words = std::min(counter / kWordBits - from, kWords);
    for (std::uint64_t i = 0; i < words; ++i) words_[(counter / kWordBits - i) % kWords] = 0;
    newest_ = counter;
    any_ = true;
  }
  words_[counter / kWordBits % kWords] |= std::uint64_t{1} << (counter % kWordBits);
}

std::uint64_t ReplayWindow::newest_bits() const {
  std::uint64_t bits = 0;
  for (std::uint64_t i = 0; any_ && i < kWordBits && i <= newest_; ++i) {
    if (is_marked(newest_ - i)) bits |= std::uint64_t{1} << i;
  }
  return bits;
}

}  // namespace tether::link
