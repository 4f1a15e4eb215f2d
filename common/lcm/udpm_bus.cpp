#include "common/lcm/udpm_bus.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cassert>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/say.hpp"
#include "common/lcm/lcm_bus.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/lcm/udp_sockets.hpp"

namespace tether {
namespace {

constexpr std::size_t kDatagramBytes = 65536;  // the longest of UDP has 65507

}  // namespace

DatagramBatch::DatagramBatch() : bytes_(kDatagrams * kDatagramBytes) {
  for (std::size_t i = 0; i < kDatagrams; ++i) {
    parts_[i] = {bytes_.data() + i * kDatagramBytes, kDatagramBytes};
    messages_[i].msg_hdr.msg_iov = &parts_[i];
    messages_[i].msg_hdr.msg_iovlen = 1;
    messages_[i].msg_hdr.msg_name = &senders_[i];
    messages_[i].msg_hdr.msg_control = &arrivals_[i];
  }
}

int DatagramBatch::receive(int fd) {
  for (mmsghdr& m : messages_) {
    m.msg_hdr.msg_namelen = sizeof(sockaddr_in);
    m.msg_hdr.msg_controllen = sizeof(Arrival);
  }
  return recvmmsg(fd, messages_.data(), kDatagrams, MSG_DONTWAIT, nullptr);
}

std::optional<std::int64_t> DatagramBatch::arrival_ns(std::size_t i) const {
  const cmsghdr& note = arrivals_[i].note;
  if (messages_[i].msg_hdr.msg_controllen < sizeof(cmsghdr) || note.cmsg_type != SCM_TIMESTAMPNS) {
    return std::nullopt;
  }
  timespec time{};
  std::memcpy(&time, CMSG_DATA(&note), sizeof time);
  return time.tv_sec * 1'000'000'000LL + time.tv_nsec;
}

std::span<const std::uint8_t> DatagramBatch::datagram(std::size_t i) const {
  return {bytes_.data() + i * kDatagramBytes, messages_[i].msg_len};
}

namespace {

constexpr char kSelfTest[] = "LCM_SELF_TEST";  // LCM instances talking to themselves

std::uint64_t one_number(const sockaddr_in& address) {
  return std::uint64_t{address.sin_addr.s_addr} << 16 | address.sin_port;
}

}  // namespace

UdpmBus::UdpmBus(const std::string& url, EventLoop& loop, Filter filter)
    : loop_(loop), filter_(std::move(filter)), url_(checked_lcm_url(url)) {
  if (!reachable_over_loopback(url_)) reachable_lcm_url(url_);  // throws
  assert(!multicast_group(url_).empty());
  sending_fd_ = open_udpm_sender(url_);
  sockaddr_in own{};
  socklen_t size = sizeof own;
  check_system_call("asking for the own port",
                    getsockname(sending_fd_, reinterpret_cast<sockaddr*>(&own), &size));
  own_port_ = own.sin_port;
  group_ = udpm_address(url_);
  local_ = lcm_option(url_, "ttl") == 0;
}

UdpmBus::~UdpmBus() {
  if (receiving_fd_ >= 0) {
    loop_.remove_fd(own_addresses_->fd());
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
    sent = send_udpm(sending_fd_, url_, message) && sent;
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
  batch_ = std::make_unique<DatagramBatch>();
  receiving_fd_ = open_udpm_receiver(url_);
  own_addresses_.emplace();
  loop_.add_fd(own_addresses_->fd(), [this](Instant) { refresh(); });
  loop_.add_fd(receiving_fd_, [this](Instant) { receive(); });
}

bool UdpmBus::refresh() {
  const bool changed = own_addresses_->refresh();
  if (changed) join_udpm_group(receiving_fd_, url_);
  return changed;
}

bool UdpmBus::is_of_this_host(in_addr sender) {
  return own_addresses_->contains(sender) || (refresh() && own_addresses_->contains(sender));
}

void UdpmBus::ignore(in_addr sender) {
  if (of_other_hosts_++ > 0) return;
  say(Severity::warning,
      fmt::format("LCM messages of {}, another host, are ignored: {} has ttl=0, so the network is "
                  "this host's alone. For a network of several hosts: ttl=1",
                  inet_ntoa(sender), url_));
}

void UdpmBus::receive() {
  // One batch, so that timers run on time under a flood of messages.
  const int count = batch_->receive(receiving_fd_);
  if (count < 0 && errno != EAGAIN && errno != EINTR) check_system_call("receiving", count);
  for (std::size_t i = 0; static_cast<int>(i) < count; ++i) {
    const sockaddr_in& sender = batch_->sender(i);
    const bool maybe_own = sender.sin_port == own_port_;
    const bool of_this_host = (local_ || maybe_own) && is_of_this_host(sender.sin_addr);
    if (of_this_host && maybe_own) {
      ++own_;
    } else if (local_ && !of_this_host) {
      ignore(sender.sin_addr);
    } else if (batch_->truncated(i)) {
      ++truncated_;
    } else {
      hear(one_number(sender), batch_->arrival_ns(i).value_or(0) / 1000, batch_->datagram(i));
    }
  }
}

void UdpmBus::hear(std::uint64_t sender, std::int64_t arrival_utime,
                   std::span<const std::uint8_t> datagram) {
  std::optional<Message> message = assembler_.take(sender, datagram);
  if (!message || message->channel == kSelfTest) return;
  message->received_utime = arrival_utime;
  bool passed = !filter_;
  for (const Subscription& s : subscriptions_) {
    if (s.channel && !s.channel->matches(message->channel)) continue;
    passed = passed || filter_(*message);
    if (!passed) {
      ++refused_;
      return;
    }
    s.handler(*message);
  }
}

void UdpmBus::list_counters(CounterList& out) const {
  const LcmAssembler::Counters& c = assembler_.counters();
  out.emplace_back("datagrams_dropped", receiving_fd_ < 0 ? 0 : dropped_datagrams({receiving_fd_}));
  out.emplace_back("datagrams_of_other_hosts", of_other_hosts_);
  out.emplace_back("datagrams_own", own_);
  out.emplace_back("incomplete", c.incomplete);
  out.emplace_back("malformed", c.malformed + truncated_);
  out.emplace_back("publish_failures", publish_failures_);
  out.emplace_back("refused", refused_);
}

std::unique_ptr<Bus> open_bus(const std::string& url, EventLoop& loop, Bus::Filter filter) {
  if (multicast_group(checked_lcm_url(url)).empty()) return std::make_unique<LcmBus>(url, loop);
  return std::make_unique<UdpmBus>(url, loop, std::move(filter));
}

}  // namespace tether
