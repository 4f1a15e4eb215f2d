// Reactions of the coordinator to missing messages: repeats, asks again, gives up.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <tether/time_resend_t.hpp>

#include "common/bus/message_io.hpp"
#include "common/lockstep/channels.hpp"
#include "common/lockstep/member.hpp"
#include "tools/lockstep/time_manager.hpp"

namespace tether {
namespace {

constexpr Duration kLongestRepeat = std::chrono::seconds{1};
constexpr Duration kSignOfLife = std::chrono::seconds{2};
/// Nodes ask again for what they miss every 100 ms or more often.
constexpr Duration kStillAsking = std::chrono::milliseconds{300};

}  // namespace

void TimeManager::on_tick() {
  const Instant now = io_.now();
  if (state_ == State::done || state_ == State::failed) return;
  if (!outstanding_ && now - last_welcome_ >= kSignOfLife) sign_of_life();
  if (state_ == State::joining) {
    if (now - begun_at_ < config_.join_patience) return;
    return fail(fmt::format("{} did not join within {:.0f} s", fmt::join(missing(), ", "),
                            to_seconds(config_.join_patience)));
  }
  watch_record(now);
  watch_grant(now);
}

void TimeManager::watch_grant(Instant now) {
  if (!outstanding_) return;
  Outstanding& out = *outstanding_;
  if (now - out.sent_at >= config_.patience) {
    if (!out.missed.empty() && now - out.missed_at < kStillAsking) {
      return fail(
          fmt::format("{} did not answer within {:.1f} s: {} has not come, without which it "
                      "owes {}; {}",
                      out.message.node, to_seconds(config_.patience), out.missed, owed(),
                      advice_on_lost_messages()));
    }
    const std::string forged =
        counters_.forged == 0
            ? ""
            : fmt::format("; {} answers had not its key, and were left", counters_.forged);
    return fail(fmt::format("{} did not answer within {:.1f} s: it owes {}{}", out.message.node,
                            to_seconds(config_.patience), owed(), forged));
  }
  if (now < out.next_repeat) return;
  out.repeat_period = std::min(2 * out.repeat_period, kLongestRepeat);
  out.next_repeat = now + out.repeat_period;
  ++counters_.repeated;
  out.message.seq = grants_sent_++;
  publish(wire_, kTimeGrant, out.message);
}

void TimeManager::watch_record(Instant now) {
  if (record_queue_.empty() || now - asked_at_ < config_.resend_after) return;
  if (now - record_stuck_since_ >= config_.patience) {
    const Publication& p = record_queue_.front().message;
    return fail(
        fmt::format("message {} of {} on {} ({} bytes) was lost on its way to the "
                    "coordinator, and did not come again within {:.1f} s; {}",
                    p.number, schedule_.name(record_queue_.front().publisher), p.channel,
                    p.digest.size, to_seconds(config_.patience), advice_on_lost_messages()));
  }
  asked_at_ = now;
  for (const Recorded& r : record_queue_) {
    if (r.bytes) continue;
    time_resend_t message{};
    message.utime = run_utime();
    message.seq = counters_.resends++;
    message.session = config_.session;
    message.publisher = schedule_.name(r.publisher);
    message.channel = r.message.channel;
    message.number = r.message.number;
    asked_again_.insert(r.message.channel);
    publish(wire_, kTimeResend, message);
  }
}

std::string TimeManager::owed() const {
  if (state_ == State::joining) return "to join";
  if (!outstanding_) return "nothing";
  const time_grant_t& grant = outstanding_->message;
  return fmt::format("the answer to grant {} at t = {:.6f} s", grant.id, to_seconds(now_));
}

void TimeManager::on_node_gone(const std::string& node, const std::string& how) {
  if (state_ == State::done || state_ == State::failed) return;
  const bool owes = state_ == State::joining ||
                    (outstanding_ && schedule_.name(outstanding_->grant.node) == node);
  fail(fmt::format("{} {}{}", node, how,
                   owes ? "; it owed " + owed()
                        : fmt::format(" at t = {:.6f} s; it owed nothing then", to_seconds(now_))));
}

void TimeManager::fail(const std::string& what) {
  if (state_ == State::done || state_ == State::failed) return;
  state_ = State::failed;
  error_ = what;
  io_.stop();
}

void TimeManager::fail_disturbed(const std::string& what) {
  disturbed_ = true;
  fail(what + ": another program takes part on this run's network");
}

void TimeManager::dismiss() {
  for (std::size_t node = 0; node < config_.nodes.size(); ++node) {
    time_grant_t message{};
    message.utime = run_utime();
    message.seq = grants_sent_++;
    message.session = config_.session;
    message.id = next_id_++;
    message.node = config_.nodes[node];
    message.kind = time_grant_t::LEAVE;
    message.mac = mac_of(message, node_keys_[node]);
    publish(wire_, kTimeGrant, message);
  }
}

void TimeManager::hold(Instant until) {
  hold_until_ = until;
  go_on();
}

void TimeManager::step() {
  step_ = held_;
  go_on();
}

}  // namespace tether
