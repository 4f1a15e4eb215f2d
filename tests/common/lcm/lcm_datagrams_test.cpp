#include "common/lcm/lcm_datagrams.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <random>
#include <string>
#include <vector>

namespace tether {
namespace {

using ::testing::ElementsAre;
using Bytes = std::vector<std::uint8_t>;

constexpr std::uint64_t kAlice = 1, kBob = 2;

std::vector<Bytes> datagrams(std::uint32_t number, const std::string& channel, const Bytes& bytes) {
  std::vector<Bytes> made;
  EXPECT_TRUE(make_lcm_datagrams(number, channel, bytes, [&](auto header, auto payload) {
    made.emplace_back(header.begin(), header.end());
    made.back().insert(made.back().end(), payload.begin(), payload.end());
  }));
  return made;
}

Bytes some_bytes(std::size_t size, std::uint32_t seed = 1) {
  std::mt19937 random(seed);
  Bytes bytes(size);
  for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
  return bytes;
}

/// Feeds datagrams; the messages that come out, as "channel:size".
struct Ear {
  void hear(const Bytes& datagram, std::uint64_t sender = kAlice) {
    const auto message = assembler.take(sender, datagram);
    if (!message) return;
    heard.push_back(std::string(message->channel) + ":" + std::to_string(message->bytes.size()));
    last.assign(message->bytes.begin(), message->bytes.end());
  }
  LcmAssembler assembler;
  std::vector<std::string> heard;
  Bytes last;
};

TEST(LcmDatagrams, AShortMessageIsOneDatagramAsLcmWritesIt) {
  EXPECT_THAT(datagrams(0x01020304, "AB", {7, 8}),
              ElementsAre(Bytes{'L', 'C', '0', '2', 1, 2, 3, 4, 'A', 'B', 0, 7, 8}));
}

TEST(LcmDatagrams, FragmentsAreNumberedAndTheFirstHasTheName) {
  const auto made = datagrams(9, "AB", Bytes(70'000, 5));
  ASSERT_EQ(made.size(), 2U);
  EXPECT_EQ(Bytes(made[0].begin(), made[0].begin() + 24),
            (Bytes{'L', 'C', '0',  '3',  0, 0, 0, 9,  //
                   0,   1,   0x11, 0x70, 0, 0, 0, 0, 0, 0, 0, 2, 'A', 'B', 0, 5}));
  EXPECT_EQ(made[0].size(), 20U + 65487U);
  EXPECT_EQ(Bytes(made[1].begin(), made[1].begin() + 21),
            (Bytes{'L', 'C', '0',  '3',  0, 0, 0,    9,  //
                   0,   1,   0x11, 0x70, 0, 0, 0xff, 0xcc, 0, 1, 0, 2, 5}));
}

TEST(LcmDatagrams, MessagesOfAnyLengthComeBackWhole) {
  for (const std::size_t size : {0, 1, 65496, 65497, 65498, 65499, 130'000, 300'000, 1 << 22}) {
    const Bytes bytes = some_bytes(size);
    Ear ear;
    for (const Bytes& datagram : datagrams(1, "AB", bytes)) {
      EXPECT_LE(datagram.size(), 65507U);
      ear.hear(datagram);
    }
    EXPECT_THAT(ear.heard, ElementsAre("AB:" + std::to_string(size)));
    EXPECT_EQ(ear.last, bytes);
    EXPECT_EQ(datagrams(1, "AB", bytes).size() == 1, size <= 65496) << size;
  }
}

TEST(LcmDatagrams, NamesThatAreTooLongAreNotSentAndNotHeard) {
  const auto nothing = [](auto, auto) { FAIL(); };
  EXPECT_FALSE(make_lcm_datagrams(1, std::string(64, 'n'), {}, nothing));
  Ear ear;
  Bytes datagram = datagrams(1, std::string(63, 'n'), {1})[0];
  ear.hear(datagram);
  datagram.insert(datagram.begin() + 8, 'n');
  ear.hear(datagram);
  EXPECT_THAT(ear.heard, ElementsAre(std::string(63, 'n') + ":1"));
  EXPECT_EQ(ear.assembler.counters().malformed, 1);
}

TEST(LcmAssembler, FragmentsMayComeInAnyOrderAndTwice) {
  const Bytes bytes = some_bytes(300'000);
  std::vector<Bytes> parts = datagrams(1, "AB", bytes);
  std::reverse(parts.begin(), parts.end());
  Ear ear;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    ear.hear(parts[i]);
    if (i + 1 < parts.size()) ear.hear(parts[i]);
  }
  EXPECT_THAT(ear.heard, ElementsAre("AB:300000"));
  EXPECT_EQ(ear.last, bytes);
  EXPECT_EQ(ear.assembler.counters().malformed, 0);
}

TEST(LcmAssembler, MessagesOfSeveralSendersAreKeptApart) {
  const Bytes a = some_bytes(200'000, 1), b = some_bytes(200'000, 2);
  const auto from_alice = datagrams(1, "A", a), from_bob = datagrams(1, "B", b);
  Ear ear;
  for (std::size_t i = 0; i < from_alice.size(); ++i) {
    ear.hear(from_alice[i], kAlice);
    ear.hear(from_bob[i], kBob);
  }
  EXPECT_THAT(ear.heard, ElementsAre("A:200000", "B:200000"));
  EXPECT_EQ(ear.last, b);
}

TEST(LcmAssembler, AMissingFragmentCostsItsMessageOnly) {
  const auto first = datagrams(1, "A", Bytes(200'000)), second = datagrams(2, "B", Bytes(200'000));
  Ear ear;
  ear.hear(first[0]);
  ear.hear(first[1]);
  for (const Bytes& part : second) ear.hear(part);
  EXPECT_THAT(ear.heard, ElementsAre("B:200000"));
}

TEST(LcmAssembler, SoManyIncompleteMessagesAreKeptAndTheOldestGivenUp) {
  Ear ear;
  const auto count = static_cast<std::uint32_t>(LcmAssembler::kMaxPending);
  for (std::uint32_t i = 0; i <= count; ++i) ear.hear(datagrams(i, "A", Bytes(70'000))[0]);
  EXPECT_EQ(ear.assembler.counters().incomplete, 1);
  ear.hear(datagrams(1, "A", Bytes(70'000))[1]);
  ear.hear(datagrams(0, "A", Bytes(70'000))[1]);
  EXPECT_THAT(ear.heard, ElementsAre("A:70000"));
}

TEST(LcmAssembler, SoManyBytesAreKeptAndTheOldestGivenUp) {
  Ear ear;
  for (std::uint32_t i = 0; i < 5; ++i) ear.hear(datagrams(i, "A", Bytes(1 << 24))[0]);
  EXPECT_EQ(ear.assembler.counters().incomplete, 1);
}

TEST(LcmAssembler, ContradictionsAndImpossibleFragmentsAreCountedAndLeft) {
  const auto field = [](Bytes datagram, std::size_t at, Bytes value) {
    std::copy(value.begin(), value.end(), datagram.begin() + static_cast<std::ptrdiff_t>(at));
    return datagram;
  };
  const auto parts = datagrams(1, "AB", Bytes(70'000));
  const Bytes impossible[] = {
      {},
      {'L', 'C', '0', '2', 0, 0, 0, 1},                // no name
      {'L', 'C', '0', '2', 0, 0, 0, 1, 'A'},           // its end is missing
      {'L', 'C', '0', '4', 0, 0, 0, 1, 'A', 0},        // another protocol
      Bytes(parts[1].begin(), parts[1].begin() + 19),  // half a header
      field(parts[1], 12, {0xff, 0xff, 0xff, 0xf0}),   // offset that wraps around: crashes LCM
      field(parts[1], 12, {0, 1, 0x11, 0x70}),         // bytes beyond the end
      field(parts[1], 8, {0x7f, 0xff, 0xff, 0xff}),    // 2 GiB
      field(parts[1], 8, {3, 0, 0, 0}),                // 48 MiB in two fragments
      field(parts[1], 16, {0, 2}),                     // the third of two
      field(parts[1], 18, {0, 0})};                    // part of no message
  Ear ear;
  ear.hear(parts[0]);
  for (const Bytes& datagram : impossible) ear.hear(datagram);
  ear.hear(field(parts[1], 18, {0, 3}));             // was of two
  ear.hear(field(parts[1], 8, {0, 1, 0x11, 0x71}));  // was shorter
  EXPECT_EQ(ear.assembler.counters().malformed,
            static_cast<std::int64_t>(std::size(impossible) + 2));
  ear.hear(parts[1]);
  EXPECT_THAT(ear.heard, ElementsAre("AB:70000"));
}

TEST(LcmAssembler, RandomDatagramsHarmNothing) {
  std::mt19937 random(1);
  Ear ear;
  for (int i = 0; i < 100'000; ++i) {
    Bytes datagram{'L', 'C', '0', static_cast<std::uint8_t>('2' + random() % 2), 0, 0, 0, 1};
    const Bytes more = some_bytes(random() % 40, static_cast<std::uint32_t>(random()));
    datagram.insert(datagram.end(), more.begin(), more.end());
    if (datagram.size() > 12) datagram[8] = datagram[12] = 0;  // not too long, not too far
    ear.hear(datagram, random() % 4);
  }
  EXPECT_GT(ear.assembler.counters().malformed, 1000);
  EXPECT_GT(ear.heard.size(), 1000U);
}

}  // namespace
}  // namespace tether
