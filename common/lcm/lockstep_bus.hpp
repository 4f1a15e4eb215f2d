#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/pattern.hpp"
#include "common/lcm/lockstep_loop.hpp"
#include "common/lcm/message_digest.hpp"
#include "common/node/bus.hpp"

namespace tether {

/// The protocol's channels (docs/reference/time.md). No other channel begins with "TIME/".
inline constexpr std::string_view kTimePrefix = "TIME/";
inline constexpr char kTimeJoin[] = "TIME/JOIN";
inline constexpr char kTimeWelcome[] = "TIME/WELCOME";
inline constexpr char kTimeGrant[] = "TIME/GRANT";
inline constexpr char kTimeRequest[] = "TIME/REQUEST";
inline constexpr char kTimeResend[] = "TIME/RESEND";

/// One message that a node has published under a grant.
struct Publication {
  std::string channel;
  std::int64_t number = 0;  ///< among the node's on this channel, from 1
  Instant when{};
  std::uint64_t index = 0;  ///< LockstepLoop::take_index()
  MessageDigest digest{};   ///< by take_published()
};

/// Whether one of several expressions matches a channel.
class ChannelFilter {
 public:
  void add(const std::string& expression);
  bool matches(std::string_view channel);

 private:
  std::vector<Pattern> patterns_;
  std::map<std::string, bool, std::less<>> known_;  // channels seen so far
};

/// A node's bus in lockstep: what it publishes is noted for the coordinator and goes out with the
/// answer to the grant; what others publish comes to the node when a grant says so.
class LockstepBus final : public Bus {
 public:
  using Bytes = std::vector<std::uint8_t>;
  /// So many published messages are kept for nodes that have missed one.
  static constexpr std::size_t kKept = 1024;

  /// `wire`: the real network. Both must outlive the bus.
  LockstepBus(LockstepLoop& loop, Bus& wire) : loop_(loop), wire_(wire) {}

  void publish(std::string_view channel, std::span<const std::uint8_t> bytes) override;
  /// Whatever `queue_capacity`: each message is delivered at its time.
  void subscribe(const std::string& channel_regex, int queue_capacity, Handler handler) override;

  const std::vector<std::string>& subscriptions() const { return expressions_; }
  /// Whether the node subscribes to this channel.
  bool wants(std::string_view channel) { return wanted_.matches(channel); }

  /// Tells what all nodes subscribe to. Publishing a message that one of them receives limits how
  /// far the node may go on; a message without receivers does not. Until this is called, every
  /// message counts as received.
  void set_heard(const std::vector<std::string>& expressions);

  /// Calls the node's handlers.
  void deliver(const Message& message);

  /// Sends what was published since the last call.
  void flush();

  /// Publications since the last call, at most kKept messages.
  std::vector<Publication> take_published(const DigestKey& key);

  /// Bytes that were published lately; null if they are no longer kept.
  const Bytes* recent(std::string_view channel, std::int64_t number) const;
  /// Publishes them once more; false if they are no longer kept.
  bool publish_again(std::string_view channel, std::int64_t number);

 private:
  struct Subscription {
    Pattern channel;
    Handler handler;
  };
  struct Kept {
    std::string channel;
    std::int64_t number;
    Bytes bytes;
  };
  LockstepLoop& loop_;
  Bus& wire_;
  std::vector<Subscription> subscriptions_;
  std::vector<std::string> expressions_;
  ChannelFilter wanted_;                // the same
  std::optional<ChannelFilter> heard_;  // by any node, if that is known
  std::map<std::string, std::int64_t, std::less<>> numbers_;
  std::vector<Publication> published_;
  std::size_t published_bytes_ = 0;
  std::deque<Kept> kept_;
  std::size_t unsent_ = 0;  // number of the newest publications that are not yet sent
};

}  // namespace tether
