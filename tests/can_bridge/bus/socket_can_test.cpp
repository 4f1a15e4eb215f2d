// SocketCanPort on virtual buses of the kernel. Wall time: asserts what must hold on a busy
// machine.
#include <gmock/gmock.h>
#include <linux/can/error.h>
#include <linux/capability.h>
#include <net/if.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <functional>
#include <future>
#include <optional>
#include <string_view>
#include <thread>

#include "can_bridge/bus/link_service.hpp"
#include "can_bridge/bus/socket_can_port.hpp"
#include "can_peers.hpp"
#include "common/base/errors.hpp"
#include "socket_can_node.hpp"

namespace tether {
namespace {

using namespace std::chrono_literals;
using test::frame_with;
using test::Node;
using test::Peer;
using test::sh;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

/// A fresh virtual bus of its own for each test.
class VirtualBus : public testing::Test {
 protected:
  VirtualBus() { create(); }
  ~VirtualBus() override { (void)std::system("ip link del vcan7 2>/dev/null"); }
  static void create() { sh("ip link add dev vcan7 type vcan && ip link set vcan7 up"); }
};

std::string refusal(const std::string& interface) {
  RealTimeLoop loop(0);
  try {
    const SocketCanPort port(interface, loop);
  } catch (const std::exception& e) {
    return e.what();
  }
  return "accepted";
}

TEST(SocketCanPort, RefusesWhatCannotBeAnInterfacesName) {
  RealTimeLoop loop(0);
  for (const char* name : {"", "sixteen-letters-", "can 0", "can/0"}) {
    EXPECT_THROW(SocketCanPort(name, loop), UsageError) << name;
  }
  EXPECT_THAT(refusal(""), HasSubstr("1 to 15 characters"));
  EXPECT_THAT(refusal("fifteen-letters"), HasSubstr("no CAN interface fifteen-letters"));
}

TEST(SocketCanPort, TellsHowToGetAMissingInterface) {
  EXPECT_THAT(refusal("vcan9"), HasSubstr("ip link add dev vcan9 type vcan"));
  EXPECT_THAT(refusal("can3"), HasSubstr("ip link set can3 up type can bitrate 500000"));
  EXPECT_THAT(refusal("lo"), HasSubstr("lo cannot be used for CAN"));
}

TEST_F(VirtualBus, PassesElevenBitDataFramesThatMatchAndNothingElse) {
  sh("ip link set vcan7 down && ip link set vcan7 mtu 72 && ip link set vcan7 up");  // CAN FD
  Node node("vcan7", {{0x201, 0x7FF}, {0x700, 0x780}});
  Peer peer("vcan7");
  peer.send(0x201 | CAN_RTR_FLAG);
  peer.send(0x201 | CAN_EFF_FLAG, {1});
  peer.send_fd(0x201, 8);
  peer.send_fd(0x201, 64);
  peer.send(0x202, {2});
  peer.send(CAN_ERR_PROT | CAN_ERR_FLAG, std::vector<std::uint8_t>(8));
  peer.send(0x201, {3, 4, 5});
  peer.send(0x77F, {5});
  ASSERT_TRUE(node.until([&] { return node.frames.size() >= 2; }));
  node.run(50ms);
  EXPECT_THAT(node.frames,
              ElementsAre(CanFrame::make(0x201, {3, 4, 5}), CanFrame::make(0x77F, {5})));
  EXPECT_EQ(node.counter("can.received"), 2);
  EXPECT_EQ(node.counter("can.error_frames"), 0);
  EXPECT_EQ(node.port.state(), CanState::up);
}

TEST_F(VirtualBus, PassesLongIdentifiersThatAFilterAsksFor) {
  Node node("vcan7", {{0x0CEF1000, 0x1FFFFF00, true}, {0x201, 0x7FF}});
  Peer peer("vcan7");
  peer.send(0x0CEF1101 | CAN_EFF_FLAG, {1});
  peer.send(0x0CEF1001 | CAN_EFF_FLAG | CAN_RTR_FLAG);
  peer.send(0x201 | CAN_EFF_FLAG, {2});
  peer.send(0x000, {3});
  peer.send(0x0CEF1001 | CAN_EFF_FLAG, {4});
  peer.send(0x201, {5});
  ASSERT_TRUE(node.until([&] { return node.frames.size() >= 2; }));
  node.run(50ms);
  CanFrame extended = frame_with(0x0CEF1001, 4);
  extended.extended = true;
  EXPECT_THAT(node.frames, ElementsAre(extended, frame_with(0x201, 5)));
}

/// Runs `work` without CAP_NET_ADMIN, in a thread of its own.
void without_capability(const std::function<void()>& work) {
  std::thread([&] {
    __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
    std::array<__user_cap_data_struct, 2> data{};
    syscall(SYS_capget, &header, data.data());
    data[0].effective &= ~(1U << CAP_NET_ADMIN);
    ASSERT_EQ(syscall(SYS_capset, &header, data.data()), 0);
    work();
  }).join();
}

/// The warning of a port without CAP_NET_ADMIN.
std::string warning_of_the_powerless(const std::string& interface, const std::string& service) {
  std::string warning;
  without_capability([&] {
    RealTimeLoop loop(RealTimeLoop::wall_utime_us());
    warning = SocketCanPort(interface, loop, service).warning();
  });
  return warning;
}

/// A CanLinkService in a thread of its own, with this program's capabilities.
class Service {
 public:
  Service() : path_(testing::TempDir() + "links") {
    std::promise<void> listens;
    thread_ = std::thread([this, &listens] {
      RealTimeLoop loop(RealTimeLoop::wall_utime_us());
      const CanLinkService service(path_, loop);
      listens.set_value();
      while (!ends_) loop.run_until(loop.now() + 5ms);
    });
    listens.get_future().wait();
  }
  ~Service() { end(); }
  void end() {
    ends_ = true;
    if (thread_.joinable()) thread_.join();
  }
  const std::string& path() const { return path_; }

  /// The answer to these bytes; nullopt if it is not one errno.
  std::optional<std::int32_t> answer(std::string_view bytes) const {
    const int fd = connection();
    EXPECT_EQ(write(fd, bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
    std::int32_t error = 0;
    const ssize_t size = read(fd, &error, sizeof error);
    close(fd);
    return size == sizeof error ? std::optional(error) : std::nullopt;
  }
  int connection() const {
    const int fd = socket(AF_UNIX, SOCK_SEQPACKET, 0);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    path_.copy(address.sun_path, sizeof address.sun_path - 1);
    EXPECT_EQ(connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    return fd;
  }

 private:
  std::string path_;
  std::atomic<bool> ends_ = false;
  std::thread thread_;
};

constexpr char kNoService[] = "/nonexistent/links";

TEST_F(VirtualBus, WarnsThatAStalledAdapterCannotBeRestartedWithoutCapabilityAndService) {
  sh("ip link add dev bus7 type vcan && ip link set bus7 up");  // by its name an adapter
  EXPECT_EQ(Node("bus7").port.warning(), "");
  EXPECT_THAT(warning_of_the_powerless("bus7", kNoService),
              AllOf(HasSubstr("cannot restart bus7 after a stall"), HasSubstr("CAP_NET_ADMIN"),
                    HasSubstr("tether-can-links")));
  EXPECT_EQ(warning_of_the_powerless("vcan7", kNoService), "") << "a virtual bus never stalls";
  EXPECT_EQ(warning_of_the_powerless("bus7", Service().path()), "");
  sh("ip link del bus7");
}

TEST_F(VirtualBus, IsRestartedByTheServiceWithoutTheCapability) {
  Service service;
  without_capability([&] {
    RealTimeLoop loop(RealTimeLoop::wall_utime_us());
    SocketCanPort port("vcan7", loop, service.path());
    std::vector<CanState> states;
    port.on_state([&](CanState s) { states.push_back(s); });
    Peer peer("vcan7");
    peer.send(CAN_ERR_BUSOFF | CAN_ERR_FLAG, std::vector<std::uint8_t>(8));
    const Instant end = loop.now() + 5s;
    while (states.empty() && loop.now() < end) loop.run_until(loop.now() + 5ms);
    std::string why;
    EXPECT_TRUE(port.restart(why)) << why;
    EXPECT_TRUE(port.send(frame_with(0x201, 2)));
    EXPECT_THAT(states, ElementsAre(CanState::bus_off, CanState::up));
    service.end();
    EXPECT_FALSE(port.restart(why));
    EXPECT_THAT(why, HasSubstr("Operation not permitted"));
    EXPECT_TRUE(port.send(frame_with(0x201, 3))) << "a refused restart leaves it up";
  });
}

TEST_F(VirtualBus, TheServiceChangesCanInterfacesAlone) {
  const Service service;
  const auto ask = [&](const char* interface, LinkChange change) {
    return ask_can_link_service(service.path(), static_cast<int>(if_nametoindex(interface)),
                                change);
  };
  const CanLinkControl control;
  const auto is_up = [&](const char* interface) { return control.query(interface)->up; };
  ASSERT_TRUE(is_up("lo") && is_up("vcan7"));
  EXPECT_EQ(ask("lo", LinkChange::none), EACCES);
  EXPECT_EQ(ask("lo", LinkChange::down), EACCES);
  EXPECT_EQ(ask("absent", LinkChange::down), EACCES);
  EXPECT_TRUE(is_up("lo"));
  EXPECT_EQ(ask("vcan7", LinkChange::none), 0);
  EXPECT_TRUE(is_up("vcan7"));
  EXPECT_EQ(ask("vcan7", LinkChange::down), 0);
  EXPECT_FALSE(is_up("vcan7"));
  EXPECT_EQ(ask("vcan7", LinkChange::up), 0);
  EXPECT_TRUE(is_up("vcan7"));
}

TEST_F(VirtualBus, TheServiceRefusesWhatIsNoRequestAndWaitsForNoOne) {
  const Service service;
  const int silent = service.connection();
  const int gone = service.connection();
  close(gone);
  CanLinkRequest request{.index = static_cast<int>(if_nametoindex("vcan7")),
                         .change = LinkChange::down};
  const auto bytes = [&request] {
    return std::string(reinterpret_cast<const char*>(&request), sizeof request);
  };
  EXPECT_EQ(service.answer(bytes() + "x"), EINVAL);
  EXPECT_EQ(service.answer(bytes().substr(1)), EINVAL);
  request.change = static_cast<LinkChange>(3);
  EXPECT_EQ(service.answer(bytes()), EINVAL);
  EXPECT_TRUE(CanLinkControl().query("vcan7")->up);
  EXPECT_EQ(service.answer(std::string(100'000, 'x')), EINVAL);
  EXPECT_EQ(ask_can_link_service(service.path(), request.index, LinkChange::down), 0);
  EXPECT_FALSE(CanLinkControl().query("vcan7")->up);
  close(silent);
}

TEST_F(VirtualBus, AServiceThatEndsMeanwhileIsAnError) {
  const std::string path = testing::TempDir() + "ends";
  const int listener = socket(AF_UNIX, SOCK_SEQPACKET, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  path.copy(address.sun_path, sizeof address.sun_path - 1);
  ASSERT_EQ(bind(listener, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  ASSERT_EQ(listen(listener, 1), 0);
  std::thread ends([&] { close(accept(listener, nullptr, nullptr)); });
  EXPECT_EQ(ask_can_link_service(path, 1, LinkChange::down), EIO);
  ends.join();
  EXPECT_EQ(ask_can_link_service(path + "not", 1, LinkChange::down), EPERM);
  close(listener);
  unlink(path.c_str());
}

TEST_F(VirtualBus, ReceivesNothingBeforeItsFiltersAreSet) {
  RealTimeLoop loop(RealTimeLoop::wall_utime_us());
  SocketCanPort port("vcan7", loop);
  Peer peer("vcan7");
  peer.send(0x201, {1});
  loop.run_until(loop.now() + 50ms);
  std::vector<CanFrame> frames;
  port.on_frame({{0x201}}, [&](const CanFrame& f) { frames.push_back(f); });
  peer.send(0x201, {2});
  loop.run_until(loop.now() + 100ms);
  EXPECT_THAT(frames, ElementsAre(frame_with(0x201, 2)));
}

TEST_F(VirtualBus, IsHeardByOthersAndNotByItself) {
  Node node("vcan7", {{0, 0}});
  Node other("vcan7", {{0, 0}});
  Peer peer("vcan7");
  EXPECT_TRUE(node.port.send(CanFrame::make(0x201, {1, 2, 3, 4, 5, 6, 7, 8})));
  CanFrame extended = frame_with(0x1ABCDEF, 9);
  extended.extended = true;
  EXPECT_TRUE(node.port.send(extended));
  ASSERT_TRUE(other.until([&] { return !other.frames.empty(); }));
  node.run(50ms);
  EXPECT_THAT(node.frames, IsEmpty());
  EXPECT_THAT(other.frames, ElementsAre(CanFrame::make(0x201, {1, 2, 3, 4, 5, 6, 7, 8})));
  const auto heard = peer.take();
  ASSERT_EQ(heard.size(), 2u);
  EXPECT_EQ(heard[0].can_id, 0x201u);
  EXPECT_EQ(heard[0].can_dlc, 8);
  EXPECT_EQ(heard[1].can_id, 0x1ABCDEFu | CAN_EFF_FLAG);
  EXPECT_EQ(node.counter("can.sent"), 2);
}

TEST_F(VirtualBus, SurvivesDownAndUpOnTheSameSocket) {
  Node node("vcan7");
  sh("ip link set vcan7 down");
  ASSERT_TRUE(node.until_state(CanState::down));
  EXPECT_FALSE(node.port.send(frame_with(0x201, 1)));
  std::string why;
  EXPECT_FALSE(node.port.restart(why)) << "it was taken down on purpose";
  EXPECT_THAT(why, HasSubstr("ip link set vcan7 up"));
  sh("ip link set vcan7 up");
  ASSERT_TRUE(node.until_state(CanState::up));
  Peer peer("vcan7");
  EXPECT_TRUE(node.port.send(frame_with(0x201, 2)));
  peer.send(0x202, {3});
  ASSERT_TRUE(node.until([&] { return !node.frames.empty(); }));
  EXPECT_EQ(peer.take().at(0).data[0], 2);
  EXPECT_THAT(node.states, ElementsAre(CanState::down, CanState::up));
  EXPECT_EQ(node.counter("can.reopened"), 0);
  EXPECT_EQ(node.counter("can.send_dropped"), 1);
}

TEST_F(VirtualBus, ReportsThatItWasDownForAMoment) {
  Node node("vcan7");
  Peer peer("vcan7");
  peer.send(CAN_ERR_BUSOFF | CAN_ERR_FLAG, std::vector<std::uint8_t>(8));
  ASSERT_TRUE(node.until_state(CanState::bus_off));
  sh("ip link set vcan7 down && ip link set vcan7 up");  // the port does not look meanwhile
  ASSERT_TRUE(node.until_state(CanState::up));
  EXPECT_TRUE(node.port.send(frame_with(0x201, 1)));
  sh("ip link set vcan7 down && ip link set vcan7 up");
  node.run(50ms);
  EXPECT_THAT(node.states, ElementsAre(CanState::bus_off, CanState::down, CanState::up,
                                       CanState::down, CanState::up));
}

TEST_F(VirtualBus, IsUsableOnAnInterfaceThatComesUpLater) {
  sh("ip link set vcan7 down");
  Node node("vcan7");
  EXPECT_EQ(node.port.state(), CanState::down);
  sh("ip link set vcan7 up");
  ASSERT_TRUE(node.until_state(CanState::up));
  EXPECT_TRUE(node.port.send(frame_with(0x201, 1)));
}

TEST_F(VirtualBus, OpensARecreatedInterfaceExactlyOnce) {
  Node node("vcan7");
  sh("ip link del vcan7");
  ASSERT_TRUE(node.until_state(CanState::absent));
  EXPECT_FALSE(node.port.send(frame_with(0x201, 1)));
  std::string why;
  EXPECT_FALSE(node.port.restart(why));
  EXPECT_THAT(why, HasSubstr("no CAN interface vcan7"));
  create();
  ASSERT_TRUE(node.until_state(CanState::up));
  node.run(50ms);
  Peer peer("vcan7");
  EXPECT_TRUE(node.port.send(frame_with(0x201, 2)));
  peer.send(0x400, {3});  // not in the filters
  peer.send(0x202, {4});
  ASSERT_TRUE(node.until([&] { return !node.frames.empty(); }));
  EXPECT_THAT(node.frames, ElementsAre(frame_with(0x202, 4)));
  EXPECT_EQ(peer.take().at(0).data[0], 2);
  EXPECT_EQ(node.counter("can.reopened"), 1);
}

TEST_F(VirtualBus, NoticesARecreationThatItSlept) {
  Node node("vcan7");
  sh("ip link del vcan7");
  create();
  ASSERT_TRUE(node.until([&] { return node.counter("can.reopened") == 1; }));
  node.run(50ms);
  EXPECT_EQ(node.port.state(), CanState::up);
  EXPECT_EQ(node.counter("can.reopened"), 1);
  Peer peer("vcan7");
  peer.send(0x202, {4});
  EXPECT_TRUE(node.until([&] { return !node.frames.empty(); }));
}

TEST_F(VirtualBus, NoticesTheDeletionByASendToo) {
  Node node("vcan7");
  sh("ip link del vcan7");
  EXPECT_FALSE(node.port.send(frame_with(0x201, 1)));
  EXPECT_EQ(node.port.state(), CanState::absent);
}

TEST_F(VirtualBus, BelievesBusOffWhereNoControllerCanBeAsked) {
  Node node("vcan7");
  Peer peer("vcan7");
  peer.send(CAN_ERR_BUSOFF | CAN_ERR_FLAG, std::vector<std::uint8_t>(8));
  ASSERT_TRUE(node.until_state(CanState::bus_off));
  EXPECT_FALSE(node.port.send(frame_with(0x201, 1)));
  peer.send(CAN_ERR_RESTARTED | CAN_ERR_FLAG, std::vector<std::uint8_t>(8));
  node.run(50ms);
  EXPECT_EQ(node.port.state(), CanState::bus_off) << "a frame alone does not end it";
  EXPECT_THAT(peer.take(), IsEmpty());
  std::string why;
  EXPECT_TRUE(node.port.restart(why)) << why;
  EXPECT_TRUE(node.port.send(frame_with(0x201, 2)));
  node.run(50ms);
  EXPECT_THAT(node.states, ElementsAre(CanState::bus_off, CanState::up));
  EXPECT_EQ(node.counter("can.error_frames"), 2);
  EXPECT_EQ(node.counter("can.restarts"), 1);
}

TEST_F(VirtualBus, CountsWhatTheKernelHadToDrop) {
  constexpr int kFrames = 5000;
  Node node("vcan7");
  Peer peer("vcan7");
  for (int i = 0; i < kFrames; ++i) {
    peer.send(0x201, {1});
    // More than the kernel's own queue holds, before any socket's, it drops uncounted.
    if (i % 100 == 0) std::this_thread::sleep_for(2ms);
  }
  node.run(200ms);
  peer.send(0x201, {2});  // these bring the count, the same one
  peer.send(0x201, {3});
  ASSERT_TRUE(node.until([&] { return node.frames.back().data[0] == 3; }));
  EXPECT_GT(node.counter("can.rx_overflow"), 0);
  EXPECT_EQ(node.counter("can.rx_overflow") + node.counter("can.received"), kFrames + 2);
}

TEST_F(VirtualBus, SaysWhatTheOperatorHasToDoWithoutTheRightToRestart) {
  EXPECT_EXIT(
      {
        if (setgid(65534) != 0 || setuid(65534) != 0) _exit(9);
        RealTimeLoop loop(0);
        SocketCanPort port("vcan7", loop, kNoService);
        std::string why;
        const bool done = port.restart(why);
        fmt::print(stderr, "{}", why);
        _exit(done ? 1 : 0);
      },
      testing::ExitedWithCode(0),
      "as root: ip link set vcan7 down && ip link set vcan7 up, or start tether-can-links");
}

}  // namespace
}  // namespace tether
