#include "tools/experiment/sweep/progress.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>

namespace tether {

std::string format_duration(double seconds) {
  if (seconds < 9.95) return fmt::format("{:.1f} s", seconds);
  const auto s = static_cast<std::int64_t>(std::round(seconds));
  if (s < 100) return fmt::format("{} s", s);
  if (s < 3600) return fmt::format("{} min {:02} s", s / 60, s % 60);
  constexpr std::int64_t kTwoDays_s = 172'800;
  if (s < kTwoDays_s) return fmt::format("{} h {:02} min", s / 3600, s / 60 % 60);
  return fmt::format("{} d {:02} h", s / 86400, s / 3600 % 24);
}

std::string progress_text(const SweepProgress& progress) {
  constexpr std::size_t kWidth = 24;
  const double share = progress.known == 0 ? 1.0
                                           : static_cast<double>(progress.ended) /
                                                 static_cast<double>(progress.known);
  const auto full = static_cast<std::size_t>(share * kWidth);
  std::string bar(full, '=');
  if (full < kWidth) bar += '>';
  std::string text =
      fmt::format("[{:<{}}] {}/{} runs", bar, kWidth, progress.ended, progress.known);
  if (progress.made > 0 && progress.elapsed_s > 0.0) {
    const double per_s = static_cast<double>(progress.made) / progress.elapsed_s;
    const auto left = static_cast<double>(progress.known - progress.ended);
    text += fmt::format(", {:.3g}/s, {} to go", per_s, format_duration(left / per_s));
  }
  if (progress.failed > 0) text += fmt::format(", {} failed", progress.failed);
  return text;
}

ProgressBar::ProgressBar()
    : terminal_(isatty(STDERR_FILENO) != 0), shown_(std::chrono::steady_clock::now()) {}

void ProgressBar::show(const SweepProgress& progress) {
  const auto now = std::chrono::steady_clock::now();
  if (terminal_) {
    fmt::print(stderr, "\r\033[K{}", progress_text(progress));
    any_ = true;
  } else if (now - shown_ > std::chrono::seconds{30}) {
    fmt::print(stderr, "{}\n", progress_text(progress));
    shown_ = now;
  }
}

void ProgressBar::end() {
  if (any_) fmt::print(stderr, "\n");
  any_ = false;
}

}  // namespace tether
