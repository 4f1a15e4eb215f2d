#pragma once

#include <array>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "common/node/bus.hpp"
#include "common/node/event_loop.hpp"

namespace tether {

/// All nodes in one process and one thread: a published message is copied and delivered as an
/// event at the current instant, in the order of publication and then of subscription.
class InProcessBus final : public Bus {
 public:
  /// `loop` must outlive the bus.
  explicit InProcessBus(EventLoop& loop);
  ~InProcessBus() override;

  void publish(std::string_view channel, std::span<const std::uint8_t> bytes) override;
  /// Queues are unbounded here: `queue_capacity` has no effect.
  void subscribe(const std::string& channel_regex, int queue_capacity, Handler handler) override;

 private:
  struct Subscription;
  using Receivers = std::vector<Subscription*>;
  /// Never moved: messages on their way point to it. One line of a cache, a fleet has thousands.
  struct alignas(64) Channel {
    std::string name;
    Receivers receivers;
  };
  struct Hash {
    using is_transparent = void;
    std::size_t operator()(std::string_view text) const {
      return std::hash<std::string_view>{}(text);
    }
  };
  const Channel& channel(std::string_view name);
  const Channel& find_or_make(std::string_view name);

  EventLoop& loop_;
  std::vector<std::unique_ptr<Subscription>> subscriptions_;
  std::map<std::string, Receivers, std::less<>> named_;  // receivers of exactly one channel
  Receivers patterns_;                                   // the others
  /// By the name's hash, the one last looked for: spares most of the way through channels_.
  std::array<const Channel*, 4096> recent_{};
  // Channels seen so far, by name.
  std::unordered_map<std::string, std::unique_ptr<Channel>, Hash, std::equal_to<>> channels_;
};

}  // namespace tether
