#include "bench/network/bare_forwarder.hpp"

#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cstdint>
#include <vector>

#include "common/lcm/udp_sockets.hpp"

namespace tether::bench {
namespace {

constexpr std::size_t kDatagrams = 64;
constexpr std::size_t kDatagramBytes = 65536;

}  // namespace

BareForwarder::BareForwarder(const std::string& from, const std::string& to)
    : in_(open_udpm_receiver(from)),
      out_(open_udpm_sender(to)),
      group_(udpm_address(to)),
      thread_([this] { run(); }) {}

BareForwarder::~BareForwarder() {
  shutdown(in_, SHUT_RD);  // ends recvmmsg()
  thread_.join();
  close(in_);
  close(out_);
}

void BareForwarder::run() {
  std::vector<std::uint8_t> bytes(kDatagrams * kDatagramBytes);
  std::array<iovec, kDatagrams> parts{};
  std::array<mmsghdr, kDatagrams> datagrams{};
  for (std::size_t i = 0; i < kDatagrams; ++i) {
    datagrams[i].msg_hdr.msg_iov = &parts[i];
    datagrams[i].msg_hdr.msg_iovlen = 1;
  }
  for (;;) {
    for (std::size_t i = 0; i < kDatagrams; ++i) {
      parts[i] = {bytes.data() + i * kDatagramBytes, kDatagramBytes};
      datagrams[i].msg_hdr.msg_name = nullptr;
      datagrams[i].msg_hdr.msg_namelen = 0;
    }
    const int count = recvmmsg(in_, datagrams.data(), kDatagrams, MSG_WAITFORONE, nullptr);
    if (count <= 0 || datagrams[0].msg_len == 0) return;
    const auto received = static_cast<std::size_t>(count);
    for (std::size_t i = 0; i < received; ++i) {
      parts[i].iov_len = datagrams[i].msg_len;
      datagrams[i].msg_hdr.msg_name = &group_;
      datagrams[i].msg_hdr.msg_namelen = sizeof group_;
    }
    for (std::size_t sent = 0; sent < received;) {
      const int more = sendmmsg(out_, &datagrams[sent], static_cast<unsigned>(received - sent), 0);
      if (more < 0) return;
      sent += static_cast<std::size_t>(more);
    }
  }
}

}  // namespace tether::bench
