#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <tether/presence_t.hpp>
#include <vector>

#include "common/fleet/channel_owners.hpp"
#include "common/node/bus.hpp"
#include "common/node/event_loop.hpp"

namespace tether {

/// The node that a program is: "can" for "tether-can-bridge"; "" for a program of another name.
std::string node_of_program(std::string_view program);

/// Whether a message of a live run comes from the program that owns its channel. A program names
/// its address and port by sending RUN/PRESENCE from there, and its node by its name
/// (node_of_program()).
///
/// - A channel's owners are those that have said so in this run, with this vehicle.
/// - Before any owner was heard, and kForgotten after the last presence of all of them, messages
///   are taken from anywhere, because another program may have the owner's place: a link, a
///   localiser, a log that is played. If the owner is one of `expected`, they are refused also
///   then.
/// - Channels without an owner, and messages whose sender the network does not tell, are taken.
/// - SIM/CLOCK may be of another run: a node learns from it that a run begins.
///
/// Presences are not authenticated. They tell stray programs from a run's own, not an attacker.
class RunSenders {
 public:
  /// On the wall clock, whatever the run's rate.
  static constexpr Duration kForgotten = std::chrono::seconds{5};
  /// A sender heard less long ago makes no room for another.
  static constexpr Duration kKept = std::chrono::milliseconds{1500};
  static constexpr std::size_t kSenders = 64;

  struct Config {
    ChannelOwners owners;
    std::string vehicle;                ///< vehicle.name of the scenario
    std::vector<std::string> expected;  ///< nodes that certainly run
  };

  /// `loop` must outlive it.
  RunSenders(Config config, const EventLoop& loop);

  /// A presence. True if it is of a sender that was not known, which may not know us either.
  bool heard(const presence_t& presence, std::uint64_t sender);
  bool takes(const Message& message) const;
  /// The program in whose place the sender of this message, which is not taken, has sent it;
  /// nothing if it was only expected.
  std::optional<std::string> owner_heard(const Message& message) const;

 private:
  struct Sender {
    std::uint64_t name;
    std::string program, node;
    std::int64_t run;
    Instant heard;
  };

  /// The senders that are a node of this run: whether a message's sender is among them, and one
  /// that was heard within kForgotten.
  struct Owners {
    bool has_sender = false;
    const Sender* newest = nullptr;
  };
  Owners owners_of(const Message& message, const std::string& node) const;

  Config config_;
  const EventLoop& loop_;
  std::vector<Sender> senders_;
};

inline constexpr const char* kPresenceChannel = "RUN/PRESENCE";
/// On the wall clock, whatever the run's rate.
inline constexpr Duration kPresencePeriod = std::chrono::milliseconds{250};

/// Says on RUN/PRESENCE that this program takes part in a live run, every kPresencePeriod while the
/// loop is alive. Others learn from it who shares their network, and that
/// a program hangs. `loop` and the buses must outlive it.
class Presence {
 public:
  Presence(EventLoop& loop, std::vector<Bus*> buses, const std::string& program,
           const std::string& vehicle);
  Presence(const Presence&) = delete;
  Presence& operator=(const Presence&) = delete;

  /// Publishes a presence now, before other messages or for a program that has just started, unless
  /// one was published within kLeastGap.
  void answer();

 private:
  static constexpr Duration kLeastGap = std::chrono::milliseconds{20};
  void publish_now();

  EventLoop& loop_;
  std::vector<Bus*> buses_;
  presence_t message_{};
  std::optional<Instant> published_;
};

/// This host's name, as presences have it.
std::string host_name();

}  // namespace tether
