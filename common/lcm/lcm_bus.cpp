#include "common/lcm/lcm_bus.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <iterator>
#include <lcm/lcm-cpp.hpp>
#include <stdexcept>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/pattern.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/lcm/udp_sockets.hpp"

namespace tether {
namespace {

// LCM reports a header-only packet as a message of about 4 GiB.
constexpr std::uint32_t kMaxMessageBytes = 1U << 28;

std::string unreachable(const std::string& url) {
  const std::string group = multicast_group(url);
  if (group.empty()) {
    return fmt::format("cannot reach the LCM network {}: is its TCP service running there?", url);
  }
  return fmt::format(
      "cannot reach the LCM network {}: this machine has no route for multicast to {}. For traffic "
      "within this host:\n  sudo ip link set lo up && sudo ip route add {}/32 dev lo",
      url, group, group);
}

/// Whether the kernel has a route to the URL's multicast group. Asked before LCM opens the network,
/// because LCM would print advice of its own that fits other tools.
bool has_route(const std::string& group) {
  if (group.empty()) return true;
  const int fd =
      check_system_call("opening a socket", socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(9);
  inet_pton(AF_INET, group.c_str(), &address.sin_addr);
  const bool reachable =
      connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  close(fd);
  return reachable;
}

}  // namespace

std::string reachable_lcm_url(const std::string& url) {
  std::string checked = checked_lcm_url(url);
  if (!has_route(multicast_group(checked))) throw std::runtime_error(unreachable(checked));
  return checked;
}

struct LcmBus::Subscription {
  LcmBus* bus;
  Handler handler;

  static void on_message(const lcm::ReceiveBuffer* buffer, const std::string& channel,
                         Subscription* self) noexcept {
    if (buffer->data_size > kMaxMessageBytes) {
      ++self->bus->malformed_;
      return;
    }
    try {
      self->handler({.channel = channel,
                     .bytes = {static_cast<const std::uint8_t*>(buffer->data), buffer->data_size},
                     .received_utime = buffer->recv_utime});
    } catch (...) {
      if (!self->bus->handler_error_) self->bus->handler_error_ = std::current_exception();
    }
  }
};

LcmBus::LcmBus(const std::string& url, EventLoop& loop)
    : loop_(loop), url_(reachable_lcm_url(url)), lcm_(std::make_unique<lcm::LCM>(url_)) {
  if (!lcm_->good()) throw std::runtime_error(unreachable(url_));
  if (multicast_group(url_).empty()) listen();  // whether a TCP service is there shows only now
}

LcmBus::~LcmBus() {
  if (fd_ >= 0) loop_.remove_fd(fd_);
}

void LcmBus::listen() {
  if (fd_ >= 0) return;
  // LCM makes its receiving socket when it is first asked for its descriptor.
  const std::vector<int> before = udp_sockets(lcm_port(url_));
  fd_ = lcm_->getFileno();
  if (fd_ < 0) throw std::runtime_error(unreachable(url_));
  if (!multicast_group(url_).empty()) {
    const std::vector<int> now = udp_sockets(lcm_port(url_));
    std::set_difference(now.begin(), now.end(), before.begin(), before.end(),
                        std::back_inserter(sockets_));
  }
  loop_.add_fd(fd_, [this](Instant) { handle_pending(); });
}

void LcmBus::publish(std::string_view channel, std::span<const std::uint8_t> bytes) {
  const int result =
      lcm_->publish(std::string(channel), bytes.data(), static_cast<unsigned int>(bytes.size()));
  if (result < 0) ++publish_failures_;
}

void LcmBus::subscribe(const std::string& channel_regex, int queue_capacity, Handler handler) {
  // LCM 1.3.1 returns a subscription that crashes for a pattern that it cannot compile.
  const Pattern check(channel_regex);
  listen();
  subscriptions_.push_back(std::make_unique<Subscription>(Subscription{this, std::move(handler)}));
  // LCM puts ^ and $ around the pattern, which bind to the outer alternatives of "A|B" only.
  lcm::Subscription* subscription = lcm_->subscribeFunction(
      "(?:" + channel_regex + ")", &Subscription::on_message, subscriptions_.back().get());
  if (subscription == nullptr) {
    throw std::runtime_error(fmt::format("cannot subscribe to {} on {}", channel_regex, url_));
  }
  subscription->setQueueCapacity(queue_capacity);
}

std::int64_t LcmBus::datagrams_dropped() const { return dropped_datagrams(sockets_); }

void LcmBus::list_counters(CounterList& out) const {
  out.emplace_back("datagrams_dropped", datagrams_dropped());
  out.emplace_back("malformed", static_cast<std::int64_t>(malformed_));
  out.emplace_back("publish_failures", static_cast<std::int64_t>(publish_failures_));
}

void LcmBus::handle_pending() {
  // Bounded, so that timers run on time under a flood of messages.
  constexpr int kBurst = 64;
  for (int i = 0; i < kBurst; ++i) {
    const int handled = lcm_->handleTimeout(0);
    if (handler_error_) std::rethrow_exception(std::exchange(handler_error_, nullptr));
    if (handled < 0) throw std::runtime_error(fmt::format("lost the LCM network {}", url_));
    // LCM's pipe has a byte in it for as long as messages wait.
    int waiting = 0;
    if (handled == 0 || (ioctl(fd_, FIONREAD, &waiting) == 0 && waiting == 0)) return;
  }
}

}  // namespace tether
