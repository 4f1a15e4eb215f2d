#include "tests/netem/kernel/udp_probe.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <ctime>
#include <stdexcept>

#include "common/base/errors.hpp"

namespace tether::test {
namespace {

constexpr std::size_t kBatch = 64;             // fits into a socket's usual buffer
constexpr std::size_t kPacedBatch = 16;        // also after a pause, with 20 ms more under way
constexpr std::uint32_t kMarker = UINT32_MAX;  // instead of a number
constexpr std::size_t kMostLanes = 3;          // number of socket priorities
constexpr std::int64_t kShortestPause_ns = 500'000;

std::int64_t to_ns(const timespec& t) { return t.tv_sec * 1'000'000'000LL + t.tv_nsec; }

std::int64_t wall_ns() {
  timespec now{};
  clock_gettime(CLOCK_REALTIME, &now);
  return to_ns(now);
}

void sleep_until(std::int64_t t_ns) {
  const timespec t{t_ns / 1'000'000'000, t_ns % 1'000'000'000};
  clock_nanosleep(CLOCK_REALTIME, TIMER_ABSTIME, &t, nullptr);
}

int udp_socket() {
  return check_system_call("opening a socket", socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
}

/// 0: none.
std::int64_t time_stamp(msghdr& header) {
  for (cmsghdr* c = CMSG_FIRSTHDR(&header); c != nullptr; c = CMSG_NXTHDR(&header, c)) {
    if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SCM_TIMESTAMPNS) continue;
    timespec stamp{};
    std::memcpy(&stamp, CMSG_DATA(c), sizeof(stamp));
    return to_ns(stamp);
  }
  return 0;
}

/// Room for packets, each of which is its number.
struct Batch {
  std::array<mmsghdr, kBatch> headers{};
  std::array<iovec, kBatch> vectors{};
  std::array<std::uint32_t, kBatch> numbers{};
  alignas(cmsghdr) std::array<std::array<char, 64>, kBatch> control{};

  explicit Batch(bool with_control) {
    for (std::size_t i = 0; i < kBatch; ++i) {
      vectors[i] = {&numbers[i], sizeof(numbers[i])};
      headers[i].msg_hdr.msg_iov = &vectors[i];
      headers[i].msg_hdr.msg_iovlen = 1;
      if (!with_control) continue;
      headers[i].msg_hdr.msg_control = control[i].data();
      headers[i].msg_hdr.msg_controllen = control[i].size();
    }
  }
};

}  // namespace

std::int64_t KernelRun::received(std::size_t lane, std::size_t lanes) const {
  std::int64_t count = 0;
  for (std::size_t i = lane; i < received_ns.size(); i += lanes) count += received_ns[i] != 0;
  return count;
}

std::int64_t KernelRun::after_pause(std::int64_t t_ns) const {
  const auto pause = std::upper_bound(pauses.begin(), pauses.end(), t_ns,
                                      [](std::int64_t t, const Pause& p) { return t < p.end_ns; });
  return pause != pauses.end() && pause->begin_ns < t_ns ? pause->end_ns : t_ns;
}

UdpProbe::UdpProbe() : receiver_(udp_socket()) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  auto* generic = reinterpret_cast<sockaddr*>(&address);
  socklen_t length = sizeof(address);
  check_system_call("binding a socket", bind(receiver_, generic, length));
  check_system_call("asking for a port", getsockname(receiver_, generic, &length));
  const int on = 1;
  check_system_call("asking for time stamps",
                    setsockopt(receiver_, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof(on)));
  const int bytes = 1 << 22;  // more than usual is for the machine's root alone
  if (setsockopt(receiver_, SOL_SOCKET, SO_RCVBUFFORCE, &bytes, sizeof(bytes)) != 0) {
    check_system_call("setting a buffer",
                      setsockopt(receiver_, SOL_SOCKET, SO_RCVBUF, &bytes, sizeof(bytes)));
  }
  for (int lane = 0; lane < static_cast<int>(kMostLanes); ++lane) {
    senders_.push_back(udp_socket());
    check_system_call("connecting a socket", connect(senders_.back(), generic, length));
    check_system_call("setting a priority",
                      setsockopt(senders_.back(), SOL_SOCKET, SO_PRIORITY, &lane, sizeof(lane)));
  }
}

UdpProbe::~UdpProbe() {
  close(receiver_);
  for (const int sender : senders_) close(sender);
}

void UdpProbe::send(std::size_t first, std::size_t count, std::size_t lane) {
  Batch batch(false);
  for (std::size_t i = 0; i < count; ++i) {
    batch.numbers[i] = static_cast<std::uint32_t>(first + i);
  }
  for (std::size_t done = 0; done < count;) {
    const auto left = static_cast<unsigned>(count - done);
    done += static_cast<std::size_t>(
        check_system_call("sending", sendmmsg(senders_.at(lane), &batch.headers[done], left, 0)));
  }
}

/// True if the marker came.
bool UdpProbe::collect(KernelRun& run) {
  bool marked = false;
  for (;;) {
    Batch batch(true);
    const int got = recvmmsg(receiver_, batch.headers.data(), kBatch, MSG_DONTWAIT, nullptr);
    if (got < 0 && errno == EAGAIN) return marked;
    check_system_call("receiving", got);
    for (std::size_t i = 0; i < static_cast<std::size_t>(got); ++i) {
      if (batch.numbers[i] == kMarker) {
        marked = true;
        continue;
      }
      std::int64_t& received = run.received_ns.at(batch.numbers[i]);
      if (received != 0) throw std::runtime_error("a packet came twice");
      received = time_stamp(batch.headers[i].msg_hdr);
      if (received == 0) throw std::runtime_error("a packet without the kernel's time stamp");
    }
    if (static_cast<std::size_t>(got) < kBatch) return marked;
  }
}

void UdpProbe::await_marker(KernelRun& run) {
  send(kMarker, 1, 1);
  for (int waits = 0; !collect(run); ++waits) {
    if (waits == 50) throw std::runtime_error("a packet with priority 1 did not get through");
    pollfd waiting{receiver_, POLLIN, 0};
    check_system_call("waiting for packets", poll(&waiting, 1, 100));
  }
}

void UdpProbe::collect_rest(KernelRun& run) {
  // Until nothing came in 10 × 20 ms: not one wait, which a standstill of the machine would fill.
  for (int quiet = 0; quiet < 10; ++quiet) {
    pollfd waiting{receiver_, POLLIN, 0};
    if (check_system_call("waiting for packets", poll(&waiting, 1, 20)) > 0) quiet = 0;
    collect(run);
  }
}

KernelRun UdpProbe::send_burst(std::size_t packets) {
  KernelRun run;
  run.received_ns.resize(packets);
  for (std::size_t first = 0; first < packets; first += kBatch) {
    send(first, std::min(kBatch, packets - first), 0);
    await_marker(run);
  }
  return run;
}

KernelRun UdpProbe::send_paced(std::size_t packets, Duration interval, std::size_t lanes) {
  KernelRun run;
  run.received_ns.resize(packets);
  const auto note_pause = [&run](std::int64_t begin_ns, std::int64_t end_ns) {
    if (end_ns - begin_ns >= kShortestPause_ns) run.pauses.push_back({begin_ns, end_ns});
  };
  std::int64_t due_ns = wall_ns();
  for (std::size_t i = 0; i < packets; ++i) {
    sleep_until(due_ns);
    const std::int64_t now_ns = wall_ns();
    note_pause(due_ns, now_ns);
    run.sent_ns.push_back(now_ns);
    send(i, 1, i % lanes);
    if (i % kPacedBatch == 0) collect(run);
    const std::int64_t end_ns = wall_ns();
    note_pause(now_ns, end_ns);
    due_ns = std::max(due_ns + interval.count(), end_ns);
  }
  collect_rest(run);
  return run;
}

}  // namespace tether::test
