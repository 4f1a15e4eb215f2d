// Real LCM over UDP multicast. Run it through in_own_network.sh: it floods the network with
// garbage and makes networks of its own.
#include "common/lcm/lcm_bus.hpp"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <net/if.h>
#include <netinet/in.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <random>
#include <stdexcept>
#include <string>
#include <tether/counters_t.hpp>
#include <tether/pose_t.hpp>
#include <thread>
#include <vector>

#include "common/base/errors.hpp"
#include "common/node/message_io.hpp"
#include "common/node/real_time_loop.hpp"

namespace tether {
namespace {

using namespace std::chrono_literals;
using testing::AllOf;
using testing::HasSubstr;
using Bytes = std::vector<std::uint8_t>;

constexpr char kGroup[] = "239.255.76.67";
constexpr int kPort = 7771;
const std::string kUrl = "udpm://239.255.76.67:7771?ttl=0";

Bytes operator+(Bytes a, const Bytes& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

Bytes bytes_of(const std::string& text) { return {text.begin(), text.end()}; }

struct LcmBusTest : testing::Test {
  /// Runs the loop until `done`, which the tests then check; 10 s are for a very busy machine.
  template <class Condition>
  void run_until(Condition done) {
    const Instant end = loop.now() + 10s;
    while (!done() && loop.now() < end) loop.run_until(loop.now() + 2ms);
  }
  /// UDP may lose a message: publishes it again until `done`.
  template <class Condition>
  void publish_until(const std::string& channel, const Bytes& bytes, Condition done) {
    const Instant end = loop.now() + 10s;
    while (!done() && loop.now() < end) {
      alice.publish(channel, bytes);
      loop.run_until(loop.now() + 50ms);
    }
  }

  RealTimeLoop loop{RealTimeLoop::wall_utime_us()};
  LcmBus alice{kUrl, loop};
  LcmBus bob{kUrl, loop};
};

TEST_F(LcmBusTest, MessagesReachOtherBusesInOrder) {
  std::vector<Bytes> received;
  bob.subscribe("AGV/.*", kDeepQueue, [&](const Message& m) {
    EXPECT_EQ(m.channel, "AGV/POSE");
    received.emplace_back(m.bytes.begin(), m.bytes.end());
  });
  std::vector<Bytes> sent;
  for (std::uint8_t i = 0; i < 100; ++i) {
    sent.push_back({i, 0, 255});
    alice.publish("AGV/POSE", sent.back());
    alice.publish("CTRL/POSE", sent.back());
  }
  run_until([&] { return received.size() == sent.size(); });
  EXPECT_EQ(received, sent);
  EXPECT_EQ(alice.publish_failures(), 0U);
  EXPECT_EQ(bob.malformed(), 0U);
}

TEST_F(LcmBusTest, ABusHearsItself) {
  int received = 0;
  alice.subscribe("X", 1, [&](const Message&) { ++received; });
  publish_until("X", {1}, [&] { return received > 0; });
  EXPECT_GT(received, 0);
}

TEST_F(LcmBusTest, AChannelPatternMustMatchTheWholeName) {
  std::vector<std::string> received;
  bool done = false;
  bob.subscribe("AGV/POSE|CTRL/POSE", kDeepQueue,
                [&](const Message& m) { received.emplace_back(m.channel); });
  bob.subscribe("END", 1, [&](const Message&) { done = true; });
  for (const char* channel : {"AGV/POSE", "AGV/POSE/X", "X/CTRL/POSE", "CTRL/POSE"}) {
    alice.publish(channel, Bytes{1});
  }
  publish_until("END", {1}, [&] { return done; });
  EXPECT_THAT(received, testing::ElementsAre("AGV/POSE", "CTRL/POSE"));
}

TEST_F(LcmBusTest, TheCapacityBoundsWhatWaitsUnhandled) {
  int all = 0, few = 0;
  bob.subscribe("X", kDeepQueue, [&](const Message&) { ++all; });
  bob.subscribe("X", 1, [&](const Message&) { ++few; });
  for (int i = 0; i < 200; ++i) alice.publish("X", Bytes{1});
  // LCM's own thread receives while the loop does not run.
  std::this_thread::sleep_for(300ms);
  run_until([&] { return all == 200; });
  EXPECT_EQ(all, 200);
  EXPECT_GE(few, 1);
  EXPECT_LE(few, 10);  // LCM's default capacity would let 30 through
}

TEST_F(LcmBusTest, AMessageOf300KilobytesPasses) {
  Bytes sent(300'000);
  for (std::size_t i = 0; i < sent.size(); ++i) sent[i] = static_cast<std::uint8_t>(i % 251);
  Bytes received;
  bob.subscribe("MAP", kDeepQueue,
                [&](const Message& m) { received.assign(m.bytes.begin(), m.bytes.end()); });
  publish_until("MAP", sent, [&] { return !received.empty(); });
  EXPECT_EQ(received, sent);
}

TEST_F(LcmBusTest, AnExceptionInAHandlerComesOutOfTheRunAndTheBusStaysUsable) {
  int received = 0;
  bob.subscribe("X", kDeepQueue, [&](const Message&) {
    if (++received == 1) throw std::runtime_error("broken handler");
  });
  EXPECT_THROW(publish_until("X", {1}, [&] { return received > 1; }), std::runtime_error);
  EXPECT_EQ(received, 1);
  publish_until("X", {1}, [&] { return received > 1; });
  EXPECT_GT(received, 1);
}

TEST_F(LcmBusTest, AHandlerMayPublishAndIsNotCalledInside) {
  std::vector<std::string> log;
  bob.subscribe("PING", kDeepQueue, [&](const Message&) {
    log.push_back("ping begins");
    bob.publish("PONG", Bytes{1});
    log.push_back("ping ends");
  });
  bool pong = false;
  bob.subscribe("PONG", kDeepQueue, [&](const Message&) {
    log.push_back("pong");
    pong = true;
  });
  publish_until("PING", {1}, [&] { return pong; });
  ASSERT_GE(log.size(), 3U);
  EXPECT_EQ(log[0], "ping begins");
  EXPECT_EQ(log[1], "ping ends");
}

TEST_F(LcmBusTest, AChannelNameThatIsTooLongForLcmIsCounted) {
  alice.publish(std::string(64, 'x'), Bytes{1});
  EXPECT_EQ(alice.publish_failures(), 1U);
  alice.publish(std::string(63, 'x'), Bytes{1});
  EXPECT_EQ(alice.publish_failures(), 1U);
}

TEST_F(LcmBusTest, AMalformedPatternIsAUsageError) {
  EXPECT_THROW(bob.subscribe("(", 1, [](const Message&) {}), UsageError);
}

TEST_F(LcmBusTest, AMalformedUrlIsAUsageError) {
  EXPECT_THROW(LcmBus("udpm://239.255.76.67", loop), UsageError);
}

/// Sends raw datagrams into LCM's group, as any program on the network can.
class RawSender {
 public:
  RawSender() : fd_(socket(AF_INET, SOCK_DGRAM, 0)) {
    address_.sin_family = AF_INET;
    address_.sin_port = htons(kPort);
    inet_pton(AF_INET, kGroup, &address_.sin_addr);
  }
  ~RawSender() { close(fd_); }
  RawSender(const RawSender&) = delete;
  RawSender& operator=(const RawSender&) = delete;

  void send(const Bytes& datagram) {
    EXPECT_EQ(sendto(fd_, datagram.data(), datagram.size(), 0,
                     reinterpret_cast<const sockaddr*>(&address_), sizeof address_),
              static_cast<ssize_t>(datagram.size()));
  }

 private:
  int fd_;
  sockaddr_in address_{};
};

const Bytes kShortHeader = bytes_of("LC02") + Bytes{0, 0, 0, 0};

struct LcmBusGarbageTest : LcmBusTest {
  LcmBusGarbageTest() {
    subscribe<pose_t>(bob, "AGV/POSE", kDeepQueue, undecodable, [this](const pose_t&) { ++poses; });
    subscribe<counters_t>(bob, "SIM/COUNTERS", kDeepQueue, undecodable_counters,
                          [](const counters_t&) { ADD_FAILURE() << "decoded garbage"; });
    bob.subscribe(".*", kDeepQueue, [this](const Message& m) {
      for (const std::uint8_t b : m.bytes) checksum += b;  // reads all that it was given
    });
  }
  Bytes random_bytes(std::size_t size) {
    Bytes bytes(size);
    for (auto& b : bytes) b = static_cast<std::uint8_t>(random());
    return bytes;
  }
  /// Lets LCM keep pace, so that the kernel drops nothing.
  void send(const Bytes& datagram) {
    sender.send(datagram);
    if (++sent % 20 == 0) loop.run_until(loop.now() + 1ms);
  }
  void expect_alive() {
    pose_t pose{};
    Bytes bytes(static_cast<std::size_t>(pose.getEncodedSize()));
    pose.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    const int before = poses;
    publish_until("AGV/POSE", bytes, [&] { return poses > before; });
    EXPECT_GT(poses, before);
  }

  RawSender sender;
  std::mt19937 random{1};
  int sent = 0;
  int poses = 0;
  std::int64_t undecodable = 0;
  std::int64_t undecodable_counters = 0;
  std::uint64_t checksum = 0;
};

TEST_F(LcmBusGarbageTest, RandomDatagramsHarmNothing) {
  for (int i = 0; i < 1000; ++i) send(random_bytes(random() % 200));
  expect_alive();
  EXPECT_EQ(undecodable, 0);
}

TEST_F(LcmBusGarbageTest, RandomContentBehindLcmsMagicHarmsNothing) {
  for (int i = 0; i < 1000; ++i) send(bytes_of("LC02") + random_bytes(random() % 200));
  expect_alive();
  EXPECT_EQ(undecodable, 0);
}

TEST_F(LcmBusGarbageTest, TruncatedDatagramsHarmNothing) {
  const Bytes whole = kShortHeader + bytes_of("AGV/POSE") + Bytes{0} + random_bytes(48);
  for (std::size_t size = 0; size <= whole.size(); ++size) {
    send({whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size)});
  }
  const Bytes fragment = bytes_of("LC03");
  for (std::size_t size = 0; size < 16; ++size) send(fragment + Bytes(size, 0));
  expect_alive();
  EXPECT_GT(undecodable, 0);
}

// A datagram without the zero behind the channel's name: LCM finds one beyond the datagram's end
// and computes a size of less than nothing.
TEST_F(LcmBusGarbageTest, AnImpossibleSizeIsCountedAsMalformed) {
  publish_until("AGV/POSE", kShortHeader, [&] { return undecodable > 0; });
  const Bytes without_zero = kShortHeader + bytes_of("AGV/POSE");
  run_until([&] {
    send(without_zero);
    return bob.malformed() > 0;
  });
  EXPECT_GT(bob.malformed(), 0U);
  expect_alive();
}

TEST_F(LcmBusGarbageTest, AGarbagePayloadOnAKnownChannelIsCountedAsUndecodable) {
  const Bytes channel = kShortHeader + bytes_of("AGV/POSE") + Bytes{0};
  for (int i = 0; i < 200; ++i) send(channel + random_bytes(random() % 200));
  run_until([&] { return undecodable == 200; });
  EXPECT_EQ(undecodable, 200);
  EXPECT_EQ(poses, 0);
  expect_alive();
}

TEST_F(LcmBusGarbageTest, ImpossibleLengthsInsideAMessageAreCountedAsUndecodable) {
  counters_t counters{};
  counters.node = "sim";
  Bytes payload(static_cast<std::size_t>(counters.getEncodedSize()));
  counters.encode(payload.data(), 0, static_cast<int>(payload.size()));
  const Bytes channel = kShortHeader + bytes_of("SIM/COUNTERS") + Bytes{0};
  // The length of `node` is at byte 24, the number of counters at 32.
  for (const std::size_t field : {24, 32}) {
    for (const std::uint8_t top : {0x10, 0x7f, 0x80, 0xff}) {
      Bytes damaged = payload;
      damaged[field] = top;
      damaged[field + 1] = damaged[field + 2] = damaged[field + 3] = 0;
      send(channel + damaged);
    }
  }
  run_until([&] { return undecodable_counters == 8; });
  EXPECT_EQ(undecodable_counters, 8);
  expect_alive();
}

/// The calling thread gets a network of its own, with loopback but no route for multicast.
void enter_network_without_route() {
  ASSERT_EQ(unshare(CLONE_NEWNET), 0) << std::strerror(errno);
  ifreq request{};
  std::strcpy(request.ifr_name, "lo");
  const int fd = socket(AF_INET, SOCK_DGRAM, 0);
  ASSERT_EQ(ioctl(fd, SIOCGIFFLAGS, &request), 0);
  request.ifr_flags = static_cast<short>(request.ifr_flags | IFF_UP);
  ASSERT_EQ(ioctl(fd, SIOCSIFFLAGS, &request), 0) << std::strerror(errno);
  close(fd);
}

TEST(LcmBusUnreachable, TheErrorNamesTheCommandThatMendsTheNetwork) {
  std::thread([] {  // a network namespace belongs to a thread
    enter_network_without_route();
    RealTimeLoop loop(RealTimeLoop::wall_utime_us());
    std::string message = "no error";
    try {
      LcmBus bus(kUrl, loop);
    } catch (const std::runtime_error& error) {
      message = error.what();
    }
    ASSERT_THAT(message,
                AllOf(HasSubstr("cannot reach the LCM network udpm://239.255.76.67:7771?ttl=0"),
                      HasSubstr("no route for multicast to 239.255.76.67"),
                      HasSubstr("sudo ip route add 239.255.76.67/32 dev lo")));

    std::string mend = message.substr(message.find('\n') + 1);
    for (auto at = mend.find("sudo "); at != std::string::npos; at = mend.find("sudo ")) {
      mend.erase(at, 5);  // we are root here
    }
    ASSERT_EQ(std::system(mend.c_str()), 0) << mend;
    EXPECT_NO_THROW(LcmBus(kUrl, loop));
  })
      .join();
}

}  // namespace
}  // namespace tether
