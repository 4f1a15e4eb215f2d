#include "common/lcm/lockstep_bus.hpp"

#include <algorithm>
#include <utility>

namespace tether {
namespace {

/// A grant ends after so many published messages, so that receivers' buffers do not overflow.
constexpr std::size_t kMostMessages = 64;
constexpr std::size_t kMostBytes = 32'768;

}  // namespace

void ChannelFilter::add(const std::string& expression) {
  patterns_.emplace_back(expression);
  known_.clear();
}

bool ChannelFilter::matches(std::string_view channel) {
  const auto known = known_.find(channel);
  if (known != known_.end()) return known->second;
  const bool found = std::any_of(patterns_.begin(), patterns_.end(),
                                 [&](const Pattern& p) { return p.matches(channel); });
  return known_.emplace(std::string(channel), found).first->second;
}

void LockstepBus::publish(std::string_view channel, std::span<const std::uint8_t> bytes) {
  auto number = numbers_.find(channel);
  if (number == numbers_.end()) number = numbers_.emplace(std::string(channel), 0).first;
  Publication publication{.channel = std::string(channel),
                          .number = ++number->second,
                          .when = loop_.now(),
                          .index = loop_.take_index()};
  if (!heard_ || heard_->matches(channel)) {
    loop_.limit({loop_.now(), loop_.delivery_order(publication.index), -1});
  }
  kept_.push_back({publication.channel, publication.number, {bytes.begin(), bytes.end()}});
  if (kept_.size() > kKept) kept_.pop_front();
  published_.push_back(std::move(publication));
  published_bytes_ += bytes.size();
  if (published_.size() >= kMostMessages || published_bytes_ >= kMostBytes) loop_.stop();
  ++unsent_;
}

void LockstepBus::flush() {
  for (; unsent_ > 0; --unsent_) {
    const Kept& k = kept_[kept_.size() - unsent_];
    wire_.publish(k.channel, k.bytes);
  }
}

void LockstepBus::subscribe(const std::string& channel_regex, int, Handler handler) {
  subscriptions_.push_back({Pattern(channel_regex), std::move(handler)});
  expressions_.push_back(channel_regex);
  wanted_.add(channel_regex);
}

void LockstepBus::set_heard(const std::vector<std::string>& expressions) {
  heard_.emplace();
  for (const std::string& expression : expressions) heard_->add(expression);
}

void LockstepBus::deliver(const Message& message) {
  for (const Subscription& s : subscriptions_) {
    if (s.channel.matches(message.channel)) s.handler(message);
  }
}

std::vector<Publication> LockstepBus::take_published(const DigestKey& key) {
  published_bytes_ = 0;
  for (Publication& p : published_) {
    if (const Bytes* bytes = recent(p.channel, p.number)) p.digest = digest_of(*bytes, key);
  }
  return std::exchange(published_, {});
}

const LockstepBus::Bytes* LockstepBus::recent(std::string_view channel, std::int64_t number) const {
  const auto found = std::find_if(kept_.rbegin(), kept_.rend(), [&](const Kept& k) {
    return k.number == number && k.channel == channel;
  });
  return found == kept_.rend() ? nullptr : &found->bytes;
}

bool LockstepBus::publish_again(std::string_view channel, std::int64_t number) {
  const Bytes* bytes = recent(channel, number);
  if (bytes != nullptr) wire_.publish(channel, *bytes);
  return bytes != nullptr;
}

}  // namespace tether
