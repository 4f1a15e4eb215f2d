#include "common/lcm/udpm_bus.hpp"

#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cassert>
#include <cstring>
#include <utility>

#include "common/base/system_error.hpp"
#include "common/lcm/lcm_bus.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/lcm/udp_sockets.hpp"

namespace tether {
namespace {

constexpr std::size_t kDatagrams = 32;         // received at once
constexpr std::size_t kDatagramBytes = 65536;  // the longest of UDP has 65507
constexpr char kSelfTest[] = "LCM_SELF_TEST";  // LCM instances talking to themselves

std::uint64_t one_number(const sockaddr_in& address) {
  return std::uint64_t{address.sin_addr.s_addr} << 16 | address.sin_port;
}

}  // namespace

/// Room for the datagrams of one system call.
class UdpmBus::Batch {
 public:
  Batch() : bytes_(kDatagrams * kDatagramBytes) {
    for (std::size_t i = 0; i < kDatagrams; ++i) {
      parts_[i] = {bytes_.data() + i * kDatagramBytes, kDatagramBytes};
      messages_[i].msg_hdr.msg_iov = &parts_[i];
      messages_[i].msg_hdr.msg_iovlen = 1;
      messages_[i].msg_hdr.msg_name = &senders_[i];
      messages_[i].msg_hdr.msg_control = &arrivals_[i];
    }
  }

  /// How many were waiting, at most kDatagrams.
  std::size_t receive(int fd) {
    for (mmsghdr& m : messages_) {
      m.msg_hdr.msg_namelen = sizeof(sockaddr_in);
      m.msg_hdr.msg_controllen = sizeof(Arrival);
    }
    const int count = recvmmsg(fd, messages_.data(), kDatagrams, MSG_DONTWAIT, nullptr);
    if (count >= 0) return static_cast<std::size_t>(count);
    if (errno != EAGAIN && errno != EINTR) check_system_call("receiving", count);
    return 0;
  }
  std::uint64_t sender(std::size_t i) const { return one_number(senders_[i]); }
  std::int64_t arrival_utime(std::size_t i) const {
    const cmsghdr& note = arrivals_[i].note;
    if (messages_[i].msg_hdr.msg_controllen < sizeof(cmsghdr) ||
        note.cmsg_type != SCM_TIMESTAMPNS) {
      return 0;
    }
    timespec time{};
    std::memcpy(&time, CMSG_DATA(&note), sizeof time);
    return time.tv_sec * 1'000'000 + time.tv_nsec / 1000;
  }
  bool truncated(std::size_t i) const { return (messages_[i].msg_hdr.msg_flags & MSG_TRUNC) != 0; }
  std::span<const std::uint8_t> datagram(std::size_t i) const {
    return {bytes_.data() + i * kDatagramBytes, messages_[i].msg_len};
  }

 private:
  union Arrival {
    cmsghdr note;
    std::array<char, CMSG_SPACE(sizeof(timespec))> room;
  };

  std::vector<std::uint8_t> bytes_;
  std::array<Arrival, kDatagrams> arrivals_{};
  std::array<iovec, kDatagrams> parts_{};
  std::array<sockaddr_in, kDatagrams> senders_{};
  std::array<mmsghdr, kDatagrams> messages_{};
};

UdpmBus::UdpmBus(const std::string& url, EventLoop& loop)
    : loop_(loop), url_(reachable_lcm_url(url)) {
  assert(!multicast_group(url_).empty());
  sending_fd_ = open_udpm_sender(url_);
  sockaddr_in own{};
  socklen_t size = sizeof own;
  check_system_call("asking for the own port",
                    getsockname(sending_fd_, reinterpret_cast<sockaddr*>(&own), &size));
  own_port_ = own.sin_port;
  group_ = udpm_address(url_);
}

bool UdpmBus::is_own(std::uint64_t sender) {
  if (static_cast<in_port_t>(sender) != own_port_) return false;
  if (sender != own_sender_ && is_own_address({static_cast<in_addr_t>(sender >> 16)})) {
    own_sender_ = sender;
  }
  return sender == own_sender_;
}

UdpmBus::~UdpmBus() {
  if (receiving_fd_ >= 0) {
    loop_.remove_fd(receiving_fd_);
    close(receiving_fd_);
  }
  close(sending_fd_);
}

void UdpmBus::publish(std::string_view channel, std::span<const std::uint8_t> bytes) {
  bool sent = true;
  const auto send = [&](std::span<const std::uint8_t> header,
                        std::span<const std::uint8_t> payload) {
    std::array<iovec, 2> parts{iovec{const_cast<std::uint8_t*>(header.data()), header.size()},
                               iovec{const_cast<std::uint8_t*>(payload.data()), payload.size()}};
    msghdr message{};
    message.msg_name = &group_;
    message.msg_namelen = sizeof group_;
    message.msg_iov = parts.data();
    message.msg_iovlen = parts.size();
    sent = sendmsg(sending_fd_, &message, 0) >= 0 && sent;
  };
  sent = make_lcm_datagrams(number_++, channel, bytes, send) && sent;
  if (!sent) ++publish_failures_;
}

void UdpmBus::subscribe(const std::string& channel_regex, int, Handler handler) {
  std::optional<Pattern> channel;
  if (channel_regex != ".*") channel.emplace(channel_regex);
  subscriptions_.push_back({std::move(channel), std::move(handler)});
  listen();
}

void UdpmBus::listen() {
  if (receiving_fd_ >= 0) return;
  batch_ = std::make_unique<Batch>();
  receiving_fd_ = open_udpm_receiver(url_);
  loop_.add_fd(receiving_fd_, [this](Instant) { receive(); });
}

void UdpmBus::receive() {
  // One batch, so that timers run on time under a flood of messages.
  const std::size_t count = batch_->receive(receiving_fd_);
  for (std::size_t i = 0; i < count; ++i) {
    if (is_own(batch_->sender(i))) {
      ++own_;
    } else if (batch_->truncated(i)) {
      ++truncated_;
    } else {
      hear(batch_->sender(i), batch_->arrival_utime(i), batch_->datagram(i));
    }
  }
}

void UdpmBus::hear(std::uint64_t sender, std::int64_t arrival_utime,
                   std::span<const std::uint8_t> datagram) {
  std::optional<Message> message = assembler_.take(sender, datagram);
  if (!message || message->channel == kSelfTest) return;
  message->received_utime = arrival_utime;
  for (const Subscription& s : subscriptions_) {
    if (!s.channel || s.channel->matches(message->channel)) s.handler(*message);
  }
}

void UdpmBus::list_counters(CounterList& out) const {
  const LcmAssembler::Counters& c = assembler_.counters();
  out.emplace_back("datagrams_dropped", receiving_fd_ < 0 ? 0 : dropped_datagrams({receiving_fd_}));
  out.emplace_back("datagrams_own", own_);
  out.emplace_back("incomplete", c.incomplete);
  out.emplace_back("malformed", c.malformed + truncated_);
  out.emplace_back("publish_failures", publish_failures_);
}

}  // namespace tether
