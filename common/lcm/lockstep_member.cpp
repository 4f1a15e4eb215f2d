#include "common/lcm/lockstep_member.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <tether/time_join_t.hpp>
#include <tether/time_resend_t.hpp>
#include <tether/time_welcome_t.hpp>
#include <utility>

#include "common/base/errors.hpp"
#include "common/lcm/lockstep_bus.hpp"
#include "common/node/message_io.hpp"

namespace tether {
namespace {

constexpr Duration kTick = std::chrono::milliseconds{20};
constexpr Duration kJoinPeriod = std::chrono::milliseconds{100};

std::int32_t rank_of(const std::string& name) {
  const auto& names = lockstep_nodes();
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) throw UsageError(fmt::format("no node \"{}\" runs in lockstep", name));
  return static_cast<std::int32_t>(found - names.begin());
}

}  // namespace

const std::vector<std::string>& lockstep_nodes() {
  static const std::vector<std::string> kNodes{"sim", "netem",     "controller",
                                               "can", "localiser", "autonomy"};
  return kNodes;
}

std::string advice_on_lost_messages() {
  return "if receive buffers are too small: sudo sysctl -w net.core.rmem_max=8388608, and "
         "recv_buf_size=8388608 in the LCM URL";
}

LockstepMember::LockstepMember(Config config, EventLoop& io, Bus& wire)
    : config_(std::move(config)),
      rank_(rank_of(config_.name)),
      io_(io),
      wire_(wire),
      loop_(config_.start, rank_),
      bus_(loop_, wire) {}

void LockstepMember::join(Node& node) {
  node_ = &node;
  wire_.subscribe(".*", kDeepQueue, [this](const Message& message) { hear(message); });
  last_heard_ = io_.now();
  io_.every(io_.now(), kTick, Priority::node, [this](Instant) { on_tick(); });
}

bool LockstepMember::is_ours(std::int64_t session, const std::string& node) const {
  return session == config_.session && session != 0 && node == config_.name;
}

void LockstepMember::on_tick() {
  const Instant now = io_.now();
  if (state_ == State::joining) {
    if (heard_of_coordinator_ && now - last_heard_ >= config_.coordinator_patience) {
      return fail(silence());
    }
    if (now - kJoinPeriod >= last_join_) send_join();
  }
  if (state_ != State::waiting) return;
  if (grant_) {
    if (now - granted_at_ >= config_.patience) {
      const auto missing =
          static_cast<std::size_t>(std::find(has_.begin(), has_.end(), false) - has_.begin());
      fail(fmt::format("message {} of {} on {} ({} bytes) has not come within {:.1f} s; {}",
                       grant_->number[missing], grant_->publisher[missing],
                       grant_->channel[missing], grant_->size[missing],
                       to_seconds(config_.patience), advice_on_lost_messages()));
    } else if (now - asked_at_ >= config_.resend_after) {
      ask_again();
    }
  } else if (now - last_heard_ >= config_.coordinator_patience) {
    fail(silence());
  }
}

std::string LockstepMember::silence() const {
  return fmt::format("the coordinator has been silent for {:.0f} s",
                     to_seconds(config_.coordinator_patience));
}

void LockstepMember::send_join() {
  last_join_ = io_.now();
  time_join_t message{};
  message.utime = to_utime(loop_.now());
  message.seq = joins_++;
  message.session = config_.session;
  message.instance = config_.instance;
  message.node = config_.name;
  message.next_ns = to_ns(loop_.next().when);
  message.next_order = static_cast<std::int64_t>(loop_.next().order);
  message.subscription = bus_.subscriptions();
  message.count = static_cast<std::int32_t>(message.subscription.size());
  publish(wire_, kTimeJoin, message);
}

void LockstepMember::hear(const Message& message) {
  if (state_ == State::left || state_ == State::failed) return;
  if (!message.channel.starts_with(kTimePrefix)) {
    if (!bus_.wants(message.channel)) return;
    inbox_.add(message);
    if (grant_) carry_out();
  } else if (message.channel == kTimeWelcome) {
    on_welcome(message.bytes);
  } else if (message.channel == kTimeGrant) {
    if (time_grant_t grant{}; decode(message.bytes, grant)) on_grant(std::move(grant));
  } else if (message.channel == kTimeResend) {
    on_resend(message.bytes);
  }
}

void LockstepMember::on_welcome(std::span<const std::uint8_t> bytes) {
  time_welcome_t welcome{};
  if (!decode(bytes, welcome)) return;
  if (welcome.session == config_.session || config_.session == 0) {
    last_heard_ = io_.now();
    heard_of_coordinator_ = true;
  }
  const bool any = config_.session == 0 && welcome.session != 0 && welcome.node == config_.name;
  if (state_ != State::joining || welcome.instance != config_.instance ||
      !(any || is_ours(welcome.session, welcome.node))) {
    return;
  }
  const auto run_key = key_of_hex(welcome.run_key), own_key = key_of_hex(welcome.node_key);
  if (!run_key || !own_key) return;
  run_key_ = *run_key;
  own_key_ = *own_key;
  config_.session = welcome.session;
  last_heard_ = io_.now();
  bus_.set_heard(welcome.subscription);
  state_ = State::waiting;
}

void LockstepMember::on_grant(time_grant_t grant) {
  if (grant.session == config_.session) last_heard_ = io_.now();
  if (state_ != State::waiting || !is_ours(grant.session, grant.node)) return;
  if (grant.mac != mac_of(grant, own_key_)) return;  // another program's
  if (grant.id == last_grant_) {  // the answer was lost, or the grant has come twice
    send_answer();
    return;
  }
  if (grant.id < last_grant_ || grant_) return;  // a late copy
  if (grant.kind == time_grant_t::LEAVE) {
    state_ = State::left;
    io_.stop();
    return;
  }
  grant_ = std::move(grant);
  granted_at_ = asked_at_ = io_.now();
  const auto count = static_cast<std::size_t>(grant_->count);
  messages_.assign(count, {});
  has_.assign(count, false);
  carry_out();
}

bool LockstepMember::collect() {
  bool complete = true;
  for (std::size_t i = 0; i < has_.size(); ++i) {
    if (has_[i]) continue;
    std::optional<MessageInbox::Bytes> bytes;
    const MessageDigest digest = digest_of_hex(grant_->size[i], grant_->digest[i]);
    if (grant_->publisher[i] == config_.name) {
      const auto* own = bus_.recent(grant_->channel[i], grant_->number[i]);
      if (own != nullptr) bytes = *own;
    } else {
      bytes = inbox_.take(grant_->channel[i], digest, run_key_);
    }
    has_[i] = bytes.has_value();
    complete = complete && has_[i];
    if (bytes) messages_[i] = std::move(*bytes);
  }
  return complete;
}

void LockstepMember::ask_again() {
  asked_at_ = io_.now();
  for (std::size_t i = 0; i < has_.size(); ++i) {
    if (has_[i]) continue;
    time_resend_t message{};
    message.utime = to_utime(loop_.now());
    message.seq = resends_++;
    message.session = config_.session;
    message.publisher = grant_->publisher[i];
    message.channel = grant_->channel[i];
    message.number = grant_->number[i];
    publish(wire_, kTimeResend, message);
  }
}

void LockstepMember::carry_out() {
  if (!collect()) return;
  loop_.begin(grant_->id);
  try {
    for (std::size_t i = 0; i < messages_.size(); ++i) {
      loop_.add(from_ns(grant_->time_ns[i]), static_cast<std::uint64_t>(grant_->order[i]),
                [this, channel = grant_->channel[i], bytes = std::move(messages_[i])](Instant) {
                  bus_.deliver({channel, bytes});
                });
    }
    const Instant until = from_ns(grant_->until_ns);
    if (grant_->kind == time_grant_t::RUN) {
      loop_.run_before(
          {until, static_cast<std::uint64_t>(grant_->until_order), grant_->until_rank});
    } else if (grant_->kind == time_grant_t::FINISH) {
      loop_.set_now(until);
      node_->finish();
    }
  } catch (const std::exception& e) {
    answer(e.what());
    throw;
  }
  answer("");
}

void LockstepMember::answer(const std::string& error) {
  answer_ = {};
  answer_.utime = to_utime(loop_.now());
  answer_.session = config_.session;
  answer_.instance = config_.instance;
  answer_.grant = grant_->id;
  answer_.grant_mac = grant_->mac;
  answer_.node = config_.name;
  answer_.next_ns = to_ns(loop_.next().when);
  answer_.next_order = static_cast<std::int64_t>(loop_.next().order);
  answer_.error = error;
  for (Publication& p : bus_.take_published(run_key_)) {
    answer_.channel.push_back(std::move(p.channel));
    answer_.number.push_back(p.number);
    answer_.time_ns.push_back(to_ns(p.when));
    answer_.index.push_back(static_cast<std::int64_t>(p.index));
    answer_.size.push_back(p.digest.size);
    answer_.digest.push_back(to_hex(p.digest.hash));
  }
  answer_.count = static_cast<std::int32_t>(answer_.channel.size());
  answer_.mac = mac_of(answer_, own_key_);
  last_grant_ = grant_->id;
  grant_.reset();
  // The coordinator works while the messages go out.
  send_answer();
  bus_.flush();
}

void LockstepMember::send_answer() {
  answer_.seq = answers_++;
  publish(wire_, kTimeRequest, answer_);
}

void LockstepMember::on_resend(std::span<const std::uint8_t> bytes) {
  time_resend_t message{};
  if (!decode(bytes, message) || !is_ours(message.session, message.publisher)) return;
  bus_.publish_again(message.channel, message.number);
}

void LockstepMember::fail(const std::string& what) {
  error_ = what;
  if (grant_) answer(what);
  state_ = State::failed;
  io_.stop();
}

}  // namespace tether
