#include "common/lcm/lcm_datagrams.hpp"

#include <vector>

#include "tests/fuzz/fuzz.hpp"
#include "tests/fuzz/script.hpp"

namespace tether::fuzzing {
namespace {

constexpr std::uint64_t kHonest = 9;  // no hostile sender has this address

/// Whatever came before, a message of an honest sender arrives whole.
void deliver(LcmAssembler& assembler, const std::vector<std::uint8_t>& bytes) {
  bool arrived = false;
  std::vector<std::uint8_t> datagram;
  make_lcm_datagrams(7, "HONEST", bytes, [&](auto header, auto payload) {
    datagram.assign(header.begin(), header.end());
    datagram.insert(datagram.end(), payload.begin(), payload.end());
    if (const auto message = assembler.take(kHonest, datagram)) {
      arrived =
          message->channel == "HONEST" &&
          std::equal(bytes.begin(), bytes.end(), message->bytes.begin(), message->bytes.end());
    }
  });
  must(arrived, "a message of an honest sender arrives whole");
}

}  // namespace

void try_input(std::span<const std::uint8_t> input) {
  Script script(input);
  const std::size_t honest_bytes = script.byte() == 'F' ? 70'000 : script.choice(32);
  LcmAssembler assembler;
  while (!script.ended()) {
    const std::uint64_t sender = script.choice(3);
    if (const auto message = assembler.take(sender, script.take_some())) {
      must(message->channel.size() <= kMaxChannelBytes, "channel names are as short as LCM's");
    }
  }
  deliver(assembler, std::vector<std::uint8_t>(honest_bytes, 0xA5));
}

}  // namespace tether::fuzzing
