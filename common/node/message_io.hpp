#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "common/base/counters.hpp"
#include "common/node/bus.hpp"
#include "common/node/event_loop.hpp"

namespace tether {

/// Walks over an encoded message without decoding it, as a visitor of its type's fields, and notes
/// whether every length in it is possible within the bytes that follow. LCM 1.3.1's generated code
/// trusts lengths from the network: a string length of −2³¹ makes it copy 2 GiB from beyond the
/// message, and a large array count allocates the array before looking at the bytes. Zeros within a
/// string would be lost when it is encoded again, as LCM has C's strings.
class LengthCheck {
 public:
  explicit LengthCheck(std::span<const std::uint8_t> bytes) : rest_(bytes) { skip(kFingerprint); }

  bool ok() const { return ok_; }

  /// Reads a field if it is an integer, because that may be an array's count, else skips it.
  template <class Field>
  void operator()(const char* name, Field& field) {
    if constexpr (std::is_array_v<Field>) {
      for (auto& element : field) (*this)(name, element);
    } else if constexpr (std::is_same_v<Field, std::string>) {
      skip_string();
    } else if constexpr (std::is_integral_v<Field>) {
      field = read<Field>();
    } else {
      skip(sizeof field);
    }
  }

  template <class Element, class Count>
  void operator()(const char* name, const std::vector<Element>&, Count count) {
    ok_ = ok_ && count >= 0;
    Element element{};
    for (Count i = 0; ok_ && i < count; ++i) (*this)(name, element);
  }

 private:
  static constexpr std::size_t kFingerprint = 8;

  void skip(std::size_t bytes) {
    ok_ = ok_ && bytes <= rest_.size();
    if (ok_) rest_ = rest_.subspan(bytes);
  }
  void skip_string() {
    const auto size = read<std::int32_t>();  // with the closing zero
    const auto text = rest_;
    ok_ = ok_ && size >= 1;
    if (ok_) skip(static_cast<std::size_t>(size));
    ok_ = ok_ && std::find(text.begin(), text.begin() + size, 0) == text.begin() + (size - 1);
  }
  template <class Integer>
  Integer read() {
    const auto field = rest_;
    skip(sizeof(Integer));
    std::uint64_t value = 0;
    for (std::size_t i = 0; ok_ && i < sizeof(Integer); ++i) value = value << 8 | field[i];
    return static_cast<Integer>(value);
  }

  std::span<const std::uint8_t> rest_;
  bool ok_ = true;
};

/// Whether generated code may decode `bytes` as LcmType. Nothing to check in fixed-size types.
template <class LcmType>
bool lengths_fit([[maybe_unused]] std::span<const std::uint8_t> bytes) {
  if constexpr (std::is_trivially_copyable_v<LcmType>) {
    return true;
  } else {
    LcmType counts{};
    LengthCheck check(bytes);
    visit_fields(counts, check);
    return check.ok();
  }
}

/// Encodes and publishes one LCM message.
template <class LcmType>
void publish(Bus& bus, std::string_view channel, const LcmType& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  bus.publish(channel, bytes);
}

/// Decodes one LCM message; false for another type, a wrong length or impossible array sizes.
/// Never throws: generated code does, for bad array and string lengths (and does worse for some:
/// see message_lengths.hpp).
template <class LcmType>
bool decode(std::span<const std::uint8_t> bytes, LcmType& message) noexcept {
  constexpr std::size_t kMaxBytes = 1 << 16;  // most of ours are below 1 KiB
  if (bytes.size() > kMaxBytes || !lengths_fit<LcmType>(bytes)) return false;
  try {
    const int size = static_cast<int>(bytes.size());
    return message.decode(bytes.data(), 0, size) == size;
  } catch (const std::exception&) {
    return false;
  }
}

/// Subscribes to one LCM type. What cannot be decoded is counted and goes no further.
template <class LcmType, class Function>
void subscribe(Bus& bus, const std::string& channel, int queue_capacity, std::int64_t& undecodable,
               Function function) {
  bus.subscribe(channel, queue_capacity,
                [&undecodable, function = std::move(function)](const Message& raw) {
                  LcmType message{};
                  if (decode(raw.bytes, message)) {
                    function(message);
                  } else {
                    ++undecodable;
                  }
                });
}

/// A message that a subscriber did not accept.
struct Rejected {
  std::int64_t undecodable = 0;
  std::int64_t other_run = 0;

  /// Appends "<prefix>.undecodable" and "<prefix>.other_run".
  void list(const std::string& prefix, CounterList& out) const {
    out.emplace_back(prefix + ".undecodable", undecodable);
    out.emplace_back(prefix + ".other_run", other_run);
  }
};

/// The same for messages that say which run they are of: those of other runs go no further either.
template <class LcmType, class Function>
void subscribe_in_run(Bus& bus, const EventLoop& loop, const std::string& channel,
                      int queue_capacity, Rejected& rejected, Function function) {
  subscribe<LcmType>(bus, channel, queue_capacity, rejected.undecodable,
                     [&loop, &rejected, function = std::move(function)](const LcmType& message) {
                       if (message.run == loop.run_id()) {
                         function(message);
                       } else {
                         ++rejected.other_run;
                       }
                     });
}

}  // namespace tether
