#include <array>
#include <tether/all_messages.hpp>
#include <vector>

#include "common/base/text.hpp"
#include "common/node/message_io.hpp"
#include "tests/fuzz/fuzz.hpp"
#include "tests/fuzz/script.hpp"
#include "tools/messages/message_printer.hpp"

namespace tether::fuzzing {
namespace {

using Bytes = std::vector<std::uint8_t>;

template <class LcmType>
Bytes encoded(const LcmType& message) {
  Bytes bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

/// A decoded message can be encoded, and is then the same.
template <class LcmType>
void try_type(std::span<const std::uint8_t> body) {
  Bytes bytes = encoded(LcmType{});
  bytes.resize(8);  // the fingerprint
  bytes.insert(bytes.end(), body.begin(), body.end());
  LcmType message{};
  if (decode(bytes, message)) {
    const Bytes once = encoded(message);
    LcmType again{};
    must(decode(once, again), "what was decoded can be encoded");
    must(encoded(again) == once, "encoding what was decoded loses nothing");
  }
  const MessageContent content = inspect_message(bytes);
  const std::string line = format_message("CHANNEL\x1b", content);
  must(line == printable(line, line.size()), "a message is shown without control characters");
  if (content.decoded()) csv_values(content.values);
}

template <class... Types>
struct Each {
  static constexpr std::array kTry{&try_type<Types>...};
};

}  // namespace

void try_input(std::span<const std::uint8_t> input) {
  Script script(input);
  const auto type = script.choice(AllMessages<Each>::kTry.size());
  AllMessages<Each>::kTry[type](script.take(input.size()));
}

}  // namespace tether::fuzzing
