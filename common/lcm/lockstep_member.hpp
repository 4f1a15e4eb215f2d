#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <tether/time_grant_t.hpp>
#include <tether/time_request_t.hpp>
#include <vector>

#include "common/lcm/lockstep_bus.hpp"
#include "common/lcm/lockstep_loop.hpp"
#include "common/lcm/message_digest.hpp"
#include "common/lcm/message_inbox.hpp"
#include "common/node/bus.hpp"
#include "common/node/event_loop.hpp"
#include "common/node/node.hpp"

namespace tether {

/// A node's part of the lockstep protocol (docs/reference/time.md): joins a run, carries out
/// grants, answers each with what the node has published and when its next event is.
///
/// Everything happens in calls of `io`, the loop of the process, whose time is wall time.
class LockstepMember {
 public:
  struct Config {
    std::int64_t session = 0;   ///< the run's number; 0: whichever run is on this network
    std::int64_t instance = 0;  ///< tells this start of the program from any other
    std::string name;           ///< a name in lockstep_nodes()
    Instant start{};            ///< start of the run's time
    /// A message that has not come within this time of its grant is asked for again, …
    Duration resend_after = std::chrono::milliseconds{40};
    /// … and missed for good after this.
    Duration patience = std::chrono::seconds{5};
    /// A coordinator that has been silent for this long is gone.
    Duration coordinator_patience = std::chrono::seconds{30};
  };

  /// `io` and `wire` must outlive the member. Throws UsageError for a name that is not in
  /// lockstep_nodes().
  LockstepMember(Config config, EventLoop& io, Bus& wire);
  LockstepMember(const LockstepMember&) = delete;
  LockstepMember& operator=(const LockstepMember&) = delete;

  /// The loop that the node has to be made with.
  EventLoop& loop() { return loop_; }
  Bus& bus() { return bus_; }

  /// Joins the run with `node`, which must outlive the member. `io` is stopped when the run is
  /// over.
  void join(Node& node);

  /// The coordinator said that it is over.
  bool has_left() const { return state_ == State::left; }
  /// Why the node took no further part; empty if nothing went wrong.
  const std::string& error() const { return error_; }

 private:
  enum class State { joining, waiting, left, failed };

  void hear(const Message& message);
  void on_welcome(std::span<const std::uint8_t> bytes);
  void on_grant(time_grant_t grant);
  void on_resend(std::span<const std::uint8_t> bytes);
  void on_tick();
  void send_join();
  std::string silence() const;
  void carry_out();
  bool collect();
  void ask_again();
  void answer(const std::string& error);
  void send_answer();
  void fail(const std::string& what);
  bool is_ours(std::int64_t session, const std::string& node) const;

  Config config_;
  std::int32_t rank_;
  EventLoop& io_;
  Bus& wire_;
  LockstepLoop loop_;
  LockstepBus bus_;
  MessageInbox inbox_;
  DigestKey run_key_{}, own_key_{};  ///< from the welcome
  Node* node_ = nullptr;
  State state_ = State::joining;
  std::string error_;
  Instant last_join_ = Instant::min();
  Instant last_heard_{};
  bool heard_of_coordinator_ = false;  ///< the session's coordinator, or any where any is accepted

  std::optional<time_grant_t> grant_;  // the grant in progress
  std::vector<MessageInbox::Bytes> messages_;
  std::vector<bool> has_;
  Instant granted_at_{};
  Instant asked_at_{};
  std::int64_t last_grant_ = 0;  // answered
  time_request_t answer_{};
  std::int64_t joins_ = 0;
  std::int64_t resends_ = 0;
  std::int64_t answers_ = 0;
};

/// Nodes that may take part, by rank: when several nodes receive one message, they do so in this
/// order.
const std::vector<std::string>& lockstep_nodes();

/// Advice against lost messages, for people.
std::string advice_on_lost_messages();

}  // namespace tether
