#include "doors/ros2/cdr_reader.hpp"

#include <bit>
#include <cmath>
#include <concepts>
#include <cstddef>

namespace tether {
namespace {

class CdrReader {
 public:
  explicit CdrReader(std::string_view cdr) {
    constexpr std::size_t kHeader = 4;
    ok_ = cdr.size() >= kHeader && cdr[0] == 0 && (cdr[1] == 0 || cdr[1] == 1);
    if (!ok_) return;
    little_ = cdr[1] == 1;
    body_ = cdr.substr(kHeader);
  }

  bool ok() const { return ok_; }
  /// Whether all has been read, but for padding to a multiple of 4.
  bool at_end() const { return ok_ && body_.size() - at_ < 4; }

  template <std::unsigned_integral T>
  T number() {
    const std::size_t begin = (at_ + sizeof(T) - 1) / sizeof(T) * sizeof(T);
    ok_ = ok_ && begin <= body_.size() && body_.size() - begin >= sizeof(T);
    if (!ok_) return 0;
    T value = 0;
    for (std::size_t i = 0; i < sizeof(T); ++i) {
      const std::size_t byte = little_ ? sizeof(T) - 1 - i : i;
      value = static_cast<T>(value << 8U) | static_cast<std::uint8_t>(body_[begin + byte]);
    }
    at_ = begin + sizeof(T);
    return value;
  }
  double real() { return std::bit_cast<double>(number<std::uint64_t>()); }
  std::string text() {
    const std::size_t size = number<std::uint32_t>();  // with the final NUL
    ok_ = ok_ && size >= 1 && size <= body_.size() - at_ && body_[at_ + size - 1] == '\0';
    if (!ok_) return "";
    std::string text(body_.substr(at_, size - 1));
    at_ += size;
    return text;
  }

 private:
  std::string_view body_;
  std::size_t at_ = 0;
  bool little_ = true;
  bool ok_ = false;
};

std::optional<RosCommand> finish(CdrReader& in, RosCommand command) {
  command.twist.v_mps = in.real();
  for (int i = 0; i < 4; ++i) command.other += std::abs(in.real());
  command.twist.omega_radps = in.real();
  if (!in.at_end()) return std::nullopt;
  return command;
}

}  // namespace

std::optional<RosCommand> read_twist(std::string_view cdr) {
  CdrReader in(cdr);
  return finish(in, {});
}

std::optional<RosCommand> read_twist_stamped(std::string_view cdr) {
  CdrReader in(cdr);
  const auto seconds = static_cast<std::int32_t>(in.number<std::uint32_t>());
  const std::int64_t rest_ns = in.number<std::uint32_t>();
  RosCommand command;
  command.header = {.stamp_ns = seconds * std::int64_t{1'000'000'000} + rest_ns,
                    .frame_id = in.text()};
  return finish(in, std::move(command));
}

}  // namespace tether
