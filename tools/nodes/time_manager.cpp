#include "tools/nodes/time_manager.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cstring>
#include <tether/time_resend_t.hpp>
#include <tether/time_welcome_t.hpp>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "common/lcm/lcm_datagrams.hpp"
#include "common/lcm/lockstep_bus.hpp"
#include "common/lcm/lockstep_member.hpp"
#include "common/node/message_io.hpp"

namespace tether {

void GrantSchedule::add_node(std::string name, const std::vector<std::string>& subscriptions,
                             const EventKey& next) {
  Node node;
  node.name = std::move(name);
  for (const std::string& expression : subscriptions) node.subscriptions.emplace_back(expression);
  node.next = next;
  nodes_.push_back(std::move(node));
}

EventKey GrantSchedule::first_event(std::size_t node) const {
  const Node& n = nodes_[node];
  if (n.waiting.empty()) return n.next;
  const Delivery& d = n.waiting.front();
  return std::min(n.next, {d.message.when, d.order, static_cast<std::int32_t>(node)});
}

Instant GrantSchedule::now() const {
  EventKey first;
  for (std::size_t i = 0; i < nodes_.size(); ++i) first = std::min(first, first_event(i));
  return first.when;
}

std::optional<GrantSchedule::Grant> GrantSchedule::next() {
  EventKey first, second{end_ + Duration{1}, 0, -1};
  std::size_t node = 0;
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    EventKey key = first_event(i);
    if (key < first) {
      std::swap(key, first);
      node = i;
    }
    second = std::min(second, key);
  }
  if (first.when > end_) return std::nullopt;
  Node& n = nodes_[node];
  n.granted_from = first;
  Grant grant{node, second, {}};
  const auto rank = static_cast<std::int32_t>(node);
  while (!n.waiting.empty() &&
         EventKey{n.waiting.front().message.when, n.waiting.front().order, rank} < second) {
    grant.deliveries.push_back(std::move(n.waiting.front()));
    n.waiting.pop_front();
  }
  return grant;
}

void GrantSchedule::check(const Node& node, const Grant& grant, const EventKey& next,
                          const std::vector<Publication>& published) {
  const auto t = [](Instant when) {
    return when == Instant::max() ? std::string("never")
                                  : fmt::format("t = {:.6f} s", to_seconds(when));
  };
  auto numbers = node.numbers;
  std::int64_t last_index = -1;
  Instant last = node.granted_from.when;
  for (const Publication& p : published) {
    if (p.when < last) {
      throw BadAnswer(fmt::format("published on {} at {}, in its past: it was at {}", p.channel,
                                  t(p.when), t(last)));
    }
    if (p.when > grant.until.when || p.when > end_) {
      throw BadAnswer(fmt::format("published on {} at {}, beyond its grant until {}", p.channel,
                                  t(p.when), t(std::min(grant.until.when, end_))));
    }
    const std::int64_t due = ++numbers[p.channel];
    if (p.channel.empty() || p.channel.size() > kMaxChannelBytes ||
        p.channel.starts_with(kTimePrefix)) {
      throw BadAnswer(fmt::format("published on \"{}\", which is no channel for it", p.channel));
    }
    check_owner(node, p.channel);
    if (p.number != due) {
      throw BadAnswer(
          fmt::format("named message {} on {} where number {} was due", p.number, p.channel, due));
    }
    if (std::cmp_less_equal(p.index, last_index) || p.index >= first_insertion(1)) {
      throw BadAnswer(fmt::format("published on {} out of order", p.channel));
    }
    last_index = static_cast<std::int64_t>(p.index);
    last = p.when;
  }
  if (next.when < last) {
    throw BadAnswer(
        fmt::format("asked for an event at {}, in its past: it was at {}", t(next.when), t(last)));
  }
}

void GrantSchedule::check_owner(const Node& node, const std::string& channel) {
  if (owners_.empty()) return;
  const auto owner = owners_.find(channel);
  if (owner != owners_.end()) {
    if (owner->second == node.name) return;
    throw BadAnswer(fmt::format("published on {}, which belongs to {}", channel, owner->second));
  }
  for (const std::size_t receiver : receivers(channel)) {
    if (nodes_[receiver].name == node.name) continue;
    throw BadAnswer(fmt::format("published on {}, which {} receives and no node of this run owns",
                                printable(channel, kLongestNameShown), nodes_[receiver].name));
  }
}

void GrantSchedule::answer(std::int64_t id, const Grant& grant, const EventKey& next,
                           const std::vector<Publication>& published) {
  Node& node = nodes_[grant.node];
  check(node, grant, next, published);
  if (next <= node.granted_from && node.granted_from < grant.until) {
    throw BadAnswer(fmt::format("did not act on its event at t = {:.6f} s",
                                to_seconds(node.granted_from.when)));
  }
  node.next = {next.when, next.order, static_cast<std::int32_t>(grant.node)};
  for (const Publication& p : published) {
    node.numbers[p.channel] = p.number;
    const std::uint64_t order =
        TimerQueue::order_of(Priority::delivery, first_insertion(id) + p.index);
    for (const std::size_t receiver : receivers(p.channel)) {
      nodes_[receiver].waiting.push_back({grant.node, p, order});
    }
  }
}

const std::vector<std::size_t>& GrantSchedule::receivers(const std::string& channel) {
  const auto known = receivers_.find(channel);
  if (known != receivers_.end()) return known->second;
  std::vector<std::size_t> found;
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    const auto& patterns = nodes_[i].subscriptions;
    const bool wants = std::any_of(patterns.begin(), patterns.end(),
                                   [&](const Pattern& p) { return p.matches(channel); });
    if (wants) found.push_back(i);
  }
  return receivers_.emplace(channel, std::move(found)).first->second;
}

namespace {

constexpr Duration kManagerTick = std::chrono::milliseconds{20};
/// More grants than any run needs at one instant of its time.
constexpr std::int64_t kMostAtOnce = 100'000;
constexpr std::size_t kMostChannels = 1000;

std::string at_time(Instant t) { return fmt::format("t = {:.6f} s", to_seconds(t)); }

EventKey next_of(const auto& message, std::size_t node) {
  return {from_ns(message.next_ns), static_cast<std::uint64_t>(message.next_order),
          static_cast<std::int32_t>(node)};
}

/// Keyed hashes are evenly distributed.
std::uint64_t number_of(const MessageDigest& digest) {
  std::uint64_t number = 0;
  std::memcpy(&number, digest.hash.data(), sizeof number);
  return number;
}

std::vector<Publication> publications_of(const time_request_t& request) {
  std::vector<Publication> published;
  for (std::size_t i = 0; i < request.channel.size(); ++i) {
    published.push_back({.channel = request.channel[i],
                         .number = request.number[i],
                         .when = from_ns(request.time_ns[i]),
                         .index = static_cast<std::uint64_t>(request.index[i]),
                         .digest = digest_of_hex(request.size[i], request.digest[i])});
  }
  return published;
}

}  // namespace

TimeManager::TimeManager(Config config, EventLoop& io, Bus& wire, Record record)
    : config_(std::move(config)),
      io_(io),
      wire_(wire),
      record_(std::move(record)),
      schedule_(config_.end, config_.owners),
      joined_(config_.nodes.size()),
      begun_at_(io.now()) {
  while (node_keys_.size() < config_.nodes.size()) node_keys_.push_back(random_digest_key());
  wire_.subscribe(".*", kDeepQueue, [this](const Message& message) { hear(message); });
  io_.every(io_.now() + kManagerTick, kManagerTick, Priority::node, [this](Instant) { on_tick(); });
}

void TimeManager::hear(const Message& message) {
  if (state_ == State::done || state_ == State::failed) return;
  if (!message.channel.starts_with(kTimePrefix)) {
    inbox_.add(message);
    if (record_queue_.empty()) return;
    take_bytes();
    go_on();
  } else if (message.channel == kTimeJoin) {
    time_join_t join{};
    const bool ours = decode(message.bytes, join) &&
                      (join.session == config_.session || join.session == time_join_t::ANY);
    if (ours) return on_join(join);
    ++counters_.foreign;
  } else if (message.channel == kTimeRequest) {
    time_request_t request{};
    const bool ours = decode(message.bytes, request) && request.session == config_.session;
    if (ours) return on_request(request);
    ++counters_.foreign;
  } else if (message.channel == kTimeResend) {
    time_resend_t resend{};
    const bool ours = decode(message.bytes, resend) && resend.session == config_.session;
    if (ours) return on_resend(resend);
    ++counters_.foreign;
  }
}

/// A node asks again for a message. If the message belongs to the outstanding grant, that explains
/// why the grant's node has not answered yet: note it for the error that may follow.
void TimeManager::on_resend(const time_resend_t& resend) {
  ++counters_.asked_again;
  if (asked_again_.size() < kMostChannels) asked_again_.insert(resend.channel);
  if (!outstanding_) return;
  const time_grant_t& grant = outstanding_->message;
  for (std::size_t i = 0; i < grant.channel.size(); ++i) {
    if (grant.channel[i] != resend.channel || grant.number[i] != resend.number) continue;
    outstanding_->missed = fmt::format("message {} of {} on {} ({} bytes)", grant.number[i],
                                       grant.publisher[i], grant.channel[i], grant.size[i]);
    outstanding_->missed_at = io_.now();
  }
}

std::vector<std::string> TimeManager::missing() const {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < joined_.size(); ++i) {
    if (!joined_[i]) names.push_back(config_.nodes[i]);
  }
  return names;
}

void TimeManager::on_join(const time_join_t& join) {
  const auto found = std::find(config_.nodes.begin(), config_.nodes.end(), join.node);
  const bool begun = state_ != State::joining;
  if (found == config_.nodes.end()) {
    return fail(fmt::format("a node \"{}\" joined{}; this run has {}", printable(join.node),
                            begun ? " late" : "", fmt::join(config_.nodes, ", ")));
  }
  const auto node = static_cast<std::size_t>(found - config_.nodes.begin());
  if (!joined_[node]) {
    joined_[node] = join;
    if (missing().empty()) start();
  } else if (joined_[node]->instance != join.instance) {
    fail(fmt::format("{} joined twice{}: as instances {} and {}", join.node,
                     begun ? ", the second time late, after the run had begun" : "",
                     joined_[node]->instance, join.instance));
  } else if (begun) {
    welcome(node);  // the welcome was lost
  }
}

void TimeManager::start() {
  for (std::size_t i = 0; i < joined_.size(); ++i) {
    try {
      schedule_.add_node(config_.nodes[i], joined_[i]->subscription, next_of(*joined_[i], i));
    } catch (const UsageError& e) {
      return fail(fmt::format("{}: {}", config_.nodes[i], e.what()));
    }
  }
  state_ = State::running;
  begun_at_ = io_.now();
  for (std::size_t i = 0; i < joined_.size(); ++i) welcome(i);
  go_on();
}

void TimeManager::welcome(std::size_t node) {
  last_welcome_ = io_.now();
  time_welcome_t message{};
  message.utime = run_utime();
  message.seq = welcomes_++;
  message.session = config_.session;
  message.instance = joined_[node]->instance;
  message.node = config_.nodes[node];
  message.rank = static_cast<std::int32_t>(node);
  message.run_key = to_hex(run_key_);
  message.node_key = to_hex(node_keys_[node]);
  for (const auto& join : joined_) {
    message.subscription.insert(message.subscription.end(), join->subscription.begin(),
                                join->subscription.end());
  }
  message.count = static_cast<std::int32_t>(message.subscription.size());
  publish(wire_, kTimeWelcome, message);
}

void TimeManager::sign_of_life() {
  last_welcome_ = io_.now();
  time_welcome_t message{};
  message.utime = run_utime();
  message.seq = welcomes_++;
  message.session = config_.session;
  publish(wire_, kTimeWelcome, message);
}

void TimeManager::on_request(const time_request_t& request) {
  const auto found = std::find(config_.nodes.begin(), config_.nodes.end(), request.node);
  if (found == config_.nodes.end() || state_ == State::joining) {
    return fail(fmt::format("\"{}\" answered grant {}, but never joined", printable(request.node),
                            request.grant));
  }
  const auto node = static_cast<std::size_t>(found - config_.nodes.begin());
  if (request.mac != mac_of(request, node_keys_[node])) {
    ++counters_.forged;
    return;
  }
  if (request.instance != joined_[node]->instance) {
    return fail(fmt::format("{} answers as instance {}, but instance {} joined", request.node,
                            request.instance, joined_[node]->instance));
  }
  const bool due = outstanding_ && outstanding_->grant.node == node;
  if (due && request.grant == outstanding_->message.id) return on_answer(request);
  if (was_answered(request.grant, node)) return on_late_answer(request);
  fail(fmt::format("{} answered grant {}, but {}", request.node, request.grant,
                   due ? "owes " + owed() : "no grant was out to it"));
}

bool TimeManager::was_answered(std::int64_t grant, std::size_t node) const {
  if (grant < kFirstGrant || grant >= next_id_) return false;
  return granted_to_[static_cast<std::size_t>(grant - kFirstGrant)] == node &&
         !(outstanding_ && outstanding_->message.id == grant);
}

void TimeManager::on_late_answer(const time_request_t& request) {
  ++counters_.late;
  if (answers_[static_cast<std::size_t>(request.grant - kFirstGrant)] == request.mac) return;
  fail_disturbed(
      fmt::format("{} answered grant {} twice, and differently", request.node, request.grant));
}

void TimeManager::on_answer(const time_request_t& request) {
  if (request.grant_mac != outstanding_->message.mac) {
    return fail_disturbed(fmt::format("{} answered a grant {} that is not the coordinator's",
                                      request.node, request.grant));
  }
  answers_.back() = request.mac;
  const Outstanding out = std::move(*outstanding_);
  const std::size_t node = out.grant.node;
  if (!request.error.empty()) {
    return fail(fmt::format("{} could not carry out grant {} at {}: {}", request.node,
                            request.grant, at_time(now_), printable(request.error)));
  }
  outstanding_.reset();
  if (out.message.kind == time_grant_t::PROBE) {
    const Duration taken = io_.now() - out.sent_at;
    if (state_ != State::closing) counters_.round_trips.push_back(taken);
    idle_ += taken;
    return go_on();
  }
  const std::vector<Publication> published = publications_of(request);
  try {
    schedule_.answer(request.grant, out.grant, next_of(request, node), published);
  } catch (const BadAnswer& e) {
    return fail(fmt::format("{} {} (grant {})", request.node, e.what(), request.grant));
  }
  if (hold_until_ != Instant::max()) tell(out.grant, request);
  if (record_queue_.empty()) record_stuck_since_ = asked_at_ = io_.now();
  for (const Publication& p : published) {
    record_queue_.push_back({node, p, std::nullopt});
    named_.insert(number_of(p.digest));
  }
  go_on();  // the next node acts while this is recorded
  take_bytes();
  go_on();
}

void TimeManager::tell(const GrantSchedule::Grant& grant, const time_request_t& request) {
  story_ = fmt::format("grant {} to {}", request.grant, request.node);
  for (const GrantSchedule::Delivery& d : grant.deliveries) {
    story_ += fmt::format(", with {} {}", d.message.channel, d.message.number);
  }
  std::map<std::string, std::pair<std::int64_t, std::int64_t>> published;
  for (std::size_t i = 0; i < request.channel.size(); ++i) {
    published.try_emplace(request.channel[i], request.number[i], 0).first->second.second =
        request.number[i];
  }
  for (const auto& [channel, numbers] : published) {
    story_ += story_.find("published") == std::string::npos ? "; it published " : ", ";
    story_ += fmt::format("{} {}", channel, numbers.first);
    if (numbers.second > numbers.first) story_ += fmt::format(" to {}", numbers.second);
  }
}

/// Records messages in order, up to the first whose bytes have not come yet.
void TimeManager::take_bytes() {
  for (Recorded& r : record_queue_) {
    if (!r.bytes) r.bytes = inbox_.take(r.message.channel, r.message.digest, run_key_);
  }
  while (!record_queue_.empty() && record_queue_.front().bytes) {
    const Recorded r = std::move(record_queue_.front());
    record_queue_.pop_front();
    record_stuck_since_ = asked_at_ = io_.now();
    record_(r.message.when, {r.message.channel, *r.bytes});
  }
}

std::map<std::string, std::size_t> TimeManager::unaccounted() const {
  auto sizes = inbox_.sizes();
  for (const std::string& channel : asked_again_) sizes.erase(channel);  // copies are left then
  return sizes;
}

/// The next grant, if none is out and the run is not held.
void TimeManager::go_on() {
  // Nodes keep only so many messages for repetition, so no node goes on while too many are
  // unrecorded.
  constexpr std::size_t kMostUnrecorded = 256;
  if (outstanding_ || state_ == State::joining || state_ == State::failed) return;
  if (record_queue_.size() > kMostUnrecorded) return;
  if (state_ == State::running) advance();
  if (state_ == State::finishing && !outstanding_) {
    if (!finish_next()) advance();
  }
  if (state_ == State::recording && record_queue_.empty()) state_ = State::closing;
  if (state_ == State::closing && !outstanding_ && !close_next()) end();
}

/// A probe of one node after another: what they have sent before has come when they answer.
bool TimeManager::close_next() {
  if (closed_ == schedule_.size()) return false;
  send({closed_++, {}, {}}, time_grant_t::PROBE);
  return true;
}

/// Done, unless messages are left on the run's channels that no node has published.
void TimeManager::end() {
  std::map<std::string, std::size_t> others;
  std::size_t size = 0;
  inbox_.for_each([&](const std::string& channel, const MessageInbox::Bytes& bytes) {
    if (named_.contains(number_of(digest_of(bytes, run_key_)))) return;  // a copy
    if (!schedule_.concerns(channel)) return;
    if (others.empty()) size = bytes.size();
    ++others[channel];
  });
  if (!others.empty()) {
    const auto& [channel, count] = *others.begin();
    return fail_disturbed(fmt::format(
        "{} message{} on {} (the first of {} bytes) {} no node's", count, count > 1 ? "s" : "",
        printable(channel, kLongestNameShown), size, count > 1 ? "are" : "is"));
  }
  state_ = State::done;
  counters_.wall_time = io_.now() - begun_at_ - idle_;
  io_.stop();
}

void TimeManager::advance() {
  const Instant next = schedule_.now();
  const bool was_held = held_;
  held_ = next > hold_until_ && !step_ && next <= config_.end;
  if (was_held && !held_) idle_ += io_.now() - held_at_;
  if (held_ && !was_held) {
    held_at_ = io_.now();
    if (on_held_) on_held_();
  }
  if (held_ || probe()) return;
  auto grant = schedule_.next();
  if (!grant) {
    state_ = state_ == State::running ? State::finishing : State::recording;
    return;
  }
  // A held run goes no further than to the time until which it may run.
  if (hold_until_ < grant->until.when && !step_) {
    grant->until = std::min(grant->until, {hold_until_ + Duration{1}, 0, -1});
  }
  step_ = false;
  at_once_ = next > now_ ? 0 : at_once_ + 1;
  now_ = std::max(now_, next);
  if (at_once_ > kMostAtOnce) {
    return fail(fmt::format("time does not go on from {}: after {} grants {} still has an event",
                            at_time(now_), kMostAtOnce, schedule_.name(grant->node)));
  }
  send(std::move(*grant), time_grant_t::RUN);
}

/// Now and then: measures a round trip, with one node after another.
bool TimeManager::probe() {
  if (config_.probe_every == 0 || ++unprobed_ <= config_.probe_every) return false;
  unprobed_ = 0;
  const auto node = counters_.round_trips.size() % schedule_.size();
  send({node, {}, {}}, time_grant_t::PROBE);
  return true;
}

/// Lets one node after another publish its final reports, before any of them is delivered.
bool TimeManager::finish_next() {
  if (finished_ == schedule_.size()) return false;
  now_ = config_.end;
  send({finished_++, {config_.end, 0, 0}, {}}, time_grant_t::FINISH);
  return true;
}

void TimeManager::send(GrantSchedule::Grant grant, std::int32_t kind) {
  time_grant_t message{};
  message.utime = run_utime();
  message.seq = grants_sent_++;
  message.session = config_.session;
  message.id = next_id_++;
  granted_to_.push_back(static_cast<std::uint8_t>(grant.node));
  answers_.emplace_back();
  message.node = schedule_.name(grant.node);
  message.kind = kind;
  message.until_ns = to_ns(grant.until.when);
  message.until_order = static_cast<std::int64_t>(grant.until.order);
  message.until_rank = grant.until.rank;
  message.count = static_cast<std::int32_t>(grant.deliveries.size());
  for (const GrantSchedule::Delivery& d : grant.deliveries) {
    message.publisher.push_back(schedule_.name(d.publisher));
    message.channel.push_back(d.message.channel);
    message.number.push_back(d.message.number);
    message.time_ns.push_back(to_ns(d.message.when));
    message.order.push_back(static_cast<std::int64_t>(d.order));
    message.size.push_back(d.message.digest.size);
    message.digest.push_back(to_hex(d.message.digest.hash));
  }
  message.mac = mac_of(message, node_keys_[grant.node]);
  if (kind != time_grant_t::PROBE) ++counters_.grants;
  const Instant now = io_.now();
  outstanding_ = Outstanding{std::move(message), std::move(grant), now, now + config_.repeat_after,
                             config_.repeat_after};
  publish(wire_, kTimeGrant, outstanding_->message);
}

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
