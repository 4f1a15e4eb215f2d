#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <tether/time_grant_t.hpp>
#include <tether/time_join_t.hpp>
#include <tether/time_request_t.hpp>
#include <tether/time_resend_t.hpp>
#include <unordered_set>
#include <utility>
#include <vector>

#include "common/base/pattern.hpp"
#include "common/fleet/channel_owners.hpp"
#include "common/lcm/lockstep_bus.hpp"
#include "common/lcm/message_digest.hpp"
#include "common/lcm/message_inbox.hpp"
#include "common/node/bus.hpp"
#include "common/node/event_loop.hpp"
#include "common/node/timer_queue.hpp"

namespace tether {

/// A node's answer contradicts its grant.
struct BadAnswer : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Which node may act next, how far, and with which messages: the conservative next-event rule
/// (docs/reference/time.md). The node whose event comes first acts, up to the first event of any
/// other. Nothing in here knows of sockets or wall time.
class GrantSchedule {
 public:
  struct Delivery {
    std::size_t publisher;
    Publication message;
    std::uint64_t order;  ///< place of the delivery among the events of its instant
  };
  struct Grant {
    std::size_t node;
    EventKey until;
    std::vector<Delivery> deliveries;
  };

  /// Nothing happens after `end`. A node may publish the channels that `owners` gives to it, and
  /// others that neither have an owner nor reach another node.
  explicit GrantSchedule(Instant end, ChannelOwners owners = {})
      : end_(end), owners_(std::move(owners)) {}

  /// In order of rank. Throws UsageError for a subscription that is no regular expression.
  void add_node(std::string name, const std::vector<std::string>& subscriptions,
                const EventKey& next);

  /// The next grant, which must be answered before the next call; nullopt if nothing is left.
  std::optional<Grant> next();

  /// Takes the answer to a grant of next(), or to one that let a node finish (then `grant` has no
  /// deliveries, and the run's end as its bound). Throws BadAnswer.
  void answer(std::int64_t id, const Grant& grant, const EventKey& next,
              const std::vector<Publication>& published);

  /// Whether a channel has an owner, or a node receives it.
  bool concerns(const std::string& channel) {
    return owners_.contains(channel) || !receivers(channel).empty();
  }
  const std::string& name(std::size_t node) const { return nodes_[node].name; }
  std::size_t size() const { return nodes_.size(); }
  /// The earliest event of all; Instant::max() if there is none.
  Instant now() const;

 private:
  struct Node {
    std::string name;
    std::vector<Pattern> subscriptions;
    EventKey next;  // the next of its own events
    std::deque<Delivery> waiting;
    std::map<std::string, std::int64_t> numbers;
    EventKey granted_from{Instant::min(), 0, 0};
  };
  EventKey first_event(std::size_t node) const;
  void check(const Node& node, const Grant& grant, const EventKey& next,
             const std::vector<Publication>& published);
  void check_owner(const Node& node, const std::string& channel);
  const std::vector<std::size_t>& receivers(const std::string& channel);

  Instant end_;
  ChannelOwners owners_;
  std::vector<Node> nodes_;
  std::map<std::string, std::vector<std::size_t>> receivers_;
};

/// The coordinator of a run in lockstep (docs/reference/time.md): waits for the nodes, and grants
/// them time one after another. It records their messages in the order in which one process would
/// have published them, and ends the run with an error that names the culprit if one does not do
/// what it owes.
///
/// Everything happens in calls of `io`, whose time is wall time; it is stopped at the end.
class TimeManager {
 public:
  struct Config {
    std::int64_t session = 1;        ///< this run's number, > 0
    std::vector<std::string> nodes;  ///< by rank
    ChannelOwners owners{};          ///< who may publish what; none: anybody anything
    Instant end{};                   ///< end of the run's time
    /// How long the coordinator waits for the nodes to join, and for an answer to a grant.
    Duration join_patience = std::chrono::seconds{20};
    Duration patience = std::chrono::seconds{10};
    /// A grant is repeated after this, then less and less often.
    Duration repeat_after = std::chrono::milliseconds{100};
    /// Time after which the coordinator asks again for a missing message.
    Duration resend_after = std::chrono::milliseconds{40};
    /// A round trip is measured after so many grants; 0: never.
    std::int64_t probe_every = 20;
  };

  /// Counters for reports.
  struct Counters {
    std::int64_t grants = 0;            ///< probes not counted
    std::int64_t repeated = 0;          ///< grants that were sent again
    std::int64_t late = 0;              ///< answers that had been given before
    std::int64_t resends = 0;           ///< messages asked for again by the coordinator
    std::int64_t asked_again = 0;       ///< messages asked for again by nodes
    std::int64_t foreign = 0;           ///< protocol messages of other sessions, or undecodable
    std::int64_t forged = 0;            ///< answers without their node's key
    std::vector<Duration> round_trips;  ///< round trips of the probes
    /// From the first grant to the end, without the probes and the time for which the run was held.
    Duration wall_time{0};
  };

  /// Called with every message of the run, in order, with the time of its delivery.
  using Record = std::function<void(Instant when, const Message& message)>;

  TimeManager(Config config, EventLoop& io, Bus& wire, Record record);
  TimeManager(const TimeManager&) = delete;
  TimeManager& operator=(const TimeManager&) = delete;

  /// The run is complete.
  bool done() const { return state_ == State::done; }
  /// Why the run failed; empty if nothing went wrong so far.
  const std::string& error() const { return error_; }
  /// It failed because another program has taken part.
  bool disturbed() const { return disturbed_; }

  /// A node's process has ended; `how`: "was killed by signal 9".
  void on_node_gone(const std::string& node, const std::string& how);
  /// Ends the run with this error.
  void fail(const std::string& what);
  /// Notifies the programs that are already there that a run begins.
  void announce() { sign_of_life(); }
  /// Tells the nodes that it is over.
  void dismiss();

  /// Called when the run has come to stand still after hold() or step().
  void on_held(std::function<void()> callback) { on_held_ = std::move(callback); }

  /// A run that is held goes no further than to the first event after `until`; Instant::max() lets
  /// it go, Instant::min() stops it.
  void hold(Instant until);
  /// Gives a held run one grant.
  void step();
  bool held() const { return held_; }

  /// Where the run has come to.
  Instant now() const { return now_; }
  bool started() const { return state_ != State::joining; }
  /// The last grant of a held run and its consequences, for people.
  const std::string& story() const { return story_; }
  /// The next event of all.
  Instant next() const { return schedule_.now(); }
  const Counters& counters() const { return counters_; }
  /// Messages on the network that no node has named as its own, by channel: copies, or another
  /// program's messages. They had no effect. Without channels on which something was asked for
  /// again.
  std::map<std::string, std::size_t> unaccounted() const;
  /// Nodes that have not joined.
  std::vector<std::string> missing() const;

 private:
  enum class State { joining, running, finishing, recording, closing, done, failed };
  struct Recorded {
    std::size_t publisher;
    Publication message;
    std::optional<MessageInbox::Bytes> bytes;
  };
  struct Outstanding {
    time_grant_t message;
    GrantSchedule::Grant grant;
    Instant sent_at;
    Instant next_repeat;
    Duration repeat_period;
    std::string missed{};  ///< the message that its node asked for last, …
    Instant missed_at{};   ///< … and when
  };

  void hear(const Message& message);
  void on_join(const time_join_t& join);
  void start();
  void welcome(std::size_t node);
  void sign_of_life();  ///< a welcome without a receiver
  void on_request(const time_request_t& request);
  bool was_answered(std::int64_t grant, std::size_t node) const;
  void on_late_answer(const time_request_t& request);
  void on_answer(const time_request_t& request);
  void on_resend(const time_resend_t& resend);
  void go_on();
  void advance();
  bool finish_next();
  bool close_next();
  void end();
  void fail_disturbed(const std::string& what);
  bool probe();
  void send(GrantSchedule::Grant grant, std::int32_t kind);
  void tell(const GrantSchedule::Grant& grant, const time_request_t& request);
  void take_bytes();
  void on_tick();
  void watch_grant(Instant now);
  void watch_record(Instant now);
  std::string owed() const;
  std::int64_t run_utime() const { return now_ == Instant::min() ? 0 : to_utime(now_); }

  Config config_;
  EventLoop& io_;
  Bus& wire_;
  Record record_;
  GrantSchedule schedule_;
  MessageInbox inbox_;
  DigestKey run_key_ = random_digest_key();
  std::vector<DigestKey> node_keys_;           // by rank
  std::vector<std::string> answers_;           // the mac of each grant's, by grant
  std::unordered_set<std::uint64_t> named_{};  // messages that nodes have published, by hash
  bool disturbed_ = false;
  std::set<std::string> asked_again_;  // channels
  State state_ = State::joining;
  std::string error_;
  std::vector<std::optional<time_join_t>> joined_;  // by rank
  std::vector<std::uint8_t> granted_to_;            // the node of each grant
  Instant begun_at_{};  // when it began to wait for nodes; later, when the run began
  Instant last_welcome_{};
  std::optional<Outstanding> outstanding_;
  std::int64_t next_id_ = kFirstGrant;
  std::int64_t unprobed_ = 0;
  std::int64_t welcomes_ = 0;
  std::int64_t grants_sent_ = 0;
  std::size_t finished_ = 0;  // nodes that were let finish
  std::size_t closed_ = 0;    // nodes that were probed at the end
  std::deque<Recorded> record_queue_;
  Instant record_stuck_since_{};
  Instant asked_at_{};
  bool held_ = false;
  Instant held_at_{};
  Duration idle_{0};          // in which the run was held, or probed
  std::int64_t at_once_ = 0;  // grants since time last went on
  Instant hold_until_ = Instant::max();
  bool step_ = false;
  Instant now_ = Instant::min();
  std::string story_;
  std::function<void()> on_held_;
  Counters counters_;
};

}  // namespace tether
