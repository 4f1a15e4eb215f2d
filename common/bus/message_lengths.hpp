#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <tether/channel_setting_result_t.hpp>
#include <tether/channel_setting_t.hpp>
#include <tether/counters_t.hpp>
#include <tether/drivetrain_state_t.hpp>
#include <tether/link_report_t.hpp>
#include <tether/plan_t.hpp>
#include <tether/time_grant_t.hpp>
#include <tether/time_join_t.hpp>
#include <tether/time_request_t.hpp>
#include <tether/time_resend_t.hpp>
#include <tether/time_welcome_t.hpp>
#include <tether/wheel_feedback_t.hpp>
#include <type_traits>

namespace tether {

/// Walks over encoded fields without decoding them, and notes whether every length in them is
/// possible within the bytes that follow. LCM 1.3.1's generated code trusts lengths from the
/// network: a string length of −2³¹ makes it copy 2 GiB from beyond the message, and a large
/// array count allocates the array before looking at the bytes.
class LengthCheck {
 public:
  explicit LengthCheck(std::span<const std::uint8_t> bytes) : rest_(bytes) {}

  LengthCheck& skip(std::size_t bytes) {
    ok_ = ok_ && bytes <= rest_.size();
    if (ok_) rest_ = rest_.subspan(bytes);
    return *this;
  }
  LengthCheck& skip_string() {
    const std::int32_t size = read_int32();  // with the closing zero
    ok_ = ok_ && size >= 1;
    return ok_ ? skip(static_cast<std::size_t>(size)) : *this;
  }
  /// A number of elements that take at least `element_bytes` each; 0 if it is impossible.
  std::int32_t read_count(std::size_t element_bytes) {
    const std::int32_t count = read_int32();
    ok_ = ok_ && count >= 0 && static_cast<std::size_t>(count) <= rest_.size() / element_bytes;
    return ok_ ? count : 0;
  }
  bool ok() const { return ok_; }

 private:
  std::int32_t read_int32() {
    const auto field = rest_;
    if (!skip(4).ok()) return 0;
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < 4; ++i) value = value << 8 | field[i];
    return static_cast<std::int32_t>(value);
  }

  std::span<const std::uint8_t> rest_;
  bool ok_ = true;
};

/// Whether generated code may decode `bytes` as LcmType. Nothing to check in fixed-size types;
/// every other type needs its own specialisation here.
template <class LcmType>
bool lengths_fit(std::span<const std::uint8_t>) {
  static_assert(std::is_trivially_copyable_v<LcmType>,
                "a type with strings or arrays needs a specialisation in message_lengths.hpp");
  return true;
}

template <>
inline bool lengths_fit<link_report_t>(std::span<const std::uint8_t> bytes) {
  constexpr std::size_t kFingerprintUtimeSeq = 24;
  return LengthCheck(bytes).skip(kFingerprintUtimeSeq).skip_string().ok();
}

template <>
inline bool lengths_fit<counters_t>(std::span<const std::uint8_t> bytes) {
  constexpr std::size_t kFingerprintUtimeSeq = 24;
  LengthCheck check(bytes);
  check.skip(kFingerprintUtimeSeq).skip_string();
  const std::int32_t count = check.read_count(4 + 1 + 8);  // of an empty name and its value
  for (std::int32_t i = 0; i < count; ++i) check.skip_string();
  return check.ok();
}

/// Two arrays of strings of the same length.
inline void skip_settings(LengthCheck& check) {
  constexpr std::size_t kTwoEmptyStrings = 4 + 1 + 4 + 1;
  const std::int32_t count = check.read_count(kTwoEmptyStrings);
  for (std::int32_t i = 0; i < 2 * count; ++i) check.skip_string();
}

template <>
inline bool lengths_fit<channel_setting_t>(std::span<const std::uint8_t> bytes) {
  constexpr std::size_t kFingerprintUtimeSeq = 24;
  LengthCheck check(bytes);
  check.skip(kFingerprintUtimeSeq);
  skip_settings(check);
  return check.ok();
}

template <>
inline bool lengths_fit<channel_setting_result_t>(std::span<const std::uint8_t> bytes) {
  constexpr std::size_t kBeforeReason = 8 + 4 * 8 + 1;
  LengthCheck check(bytes);
  check.skip(kBeforeReason).skip_string();
  skip_settings(check);
  return check.ok();
}

template <>
inline bool lengths_fit<drivetrain_state_t>(std::span<const std::uint8_t> bytes) {
  constexpr std::size_t kBeforeStrings = 8 + 8 + 8 + 4;
  return LengthCheck(bytes).skip(kBeforeStrings).skip_string().skip_string().skip_string().ok();
}

template <>
inline bool lengths_fit<plan_t>(std::span<const std::uint8_t> bytes) {
  constexpr std::size_t kBeforeCount = 8 + 9 * 8 + 4;
  constexpr std::size_t kTwist = 4 + 4;
  LengthCheck check(bytes);
  check.skip(kBeforeCount).read_count(kTwist);
  return check.ok();
}

template <>
inline bool lengths_fit<wheel_feedback_t>(std::span<const std::uint8_t> bytes) {
  constexpr std::size_t kBeforeStrings = 8 + 8 + 8 + 1 + 6 * 8 + 2 * 8 + 4 * 4;
  return LengthCheck(bytes).skip(kBeforeStrings).skip_string().skip_string().ok();
}

template <>
inline bool lengths_fit<time_join_t>(std::span<const std::uint8_t> bytes) {
  constexpr std::size_t kEmptyString = 4 + 1;
  LengthCheck check(bytes);
  check.skip(8 + 4 * 8).skip_string().skip(8 + 8);
  const std::int32_t count = check.read_count(kEmptyString);
  for (std::int32_t i = 0; i < count; ++i) check.skip_string();
  return check.ok();
}

template <>
inline bool lengths_fit<time_welcome_t>(std::span<const std::uint8_t> bytes) {
  constexpr std::size_t kEmptyString = 4 + 1;
  LengthCheck check(bytes);
  check.skip(8 + 4 * 8).skip_string().skip(4);
  const std::int32_t count = check.read_count(kEmptyString);
  for (std::int32_t i = 0; i < count; ++i) check.skip_string();
  return check.ok();
}

template <>
inline bool lengths_fit<time_grant_t>(std::span<const std::uint8_t> bytes) {
  constexpr std::size_t kShortest = 2 * (4 + 1) + 5 * 8;  // of one message
  LengthCheck check(bytes);
  check.skip(8 + 4 * 8).skip_string().skip(4 + 2 * 8 + 4);
  const std::int32_t count = check.read_count(kShortest);
  for (std::int32_t i = 0; i < 2 * count; ++i) check.skip_string();
  return check.ok();
}

template <>
inline bool lengths_fit<time_request_t>(std::span<const std::uint8_t> bytes) {
  constexpr std::size_t kShortest = 4 + 1 + 5 * 8;  // of one message
  LengthCheck check(bytes);
  check.skip(8 + 5 * 8).skip_string().skip(8 + 8).skip_string();
  const std::int32_t count = check.read_count(kShortest);
  for (std::int32_t i = 0; i < count; ++i) check.skip_string();
  return check.ok();
}

template <>
inline bool lengths_fit<time_resend_t>(std::span<const std::uint8_t> bytes) {
  return LengthCheck(bytes).skip(8 + 3 * 8).skip_string().skip_string().ok();
}

}  // namespace tether
