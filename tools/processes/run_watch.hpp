#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <tether/presence_t.hpp>
#include <utility>
#include <vector>

#include "common/base/time.hpp"

namespace tether {

/// Judges whether a live run is what it says: alone on its network, one of each program, all of
/// them alive. Pure; `now` is the run's time and must not go backwards, and all limits are on the
/// wall clock: `rate` says how many seconds of the run one of its seconds is.
///
/// - Another run: a presence of another run; its first is reported.
/// - An unknown sender: a program of this run and vehicle, of which one is there already (other
/// host or
///   process) and which this run has not started.
/// - Hung: an own program that is not heard for kSilence: stopped, in an endless loop, or cut off.
///   One that starts has until kPatience after its start, or after t = 0. After kPatience of
///   silence it is to be ended: hangs().
///
/// - Two senders that both say that they are one process.
/// - An unknown sender: one that sends on a channel of the run's programs, be it once, and is not
///   heard on RUN/PRESENCE within kSilence.
/// - A second controller: two senders on a channel of an external controller, be it once and one
///   after the other. So an external controller cannot be started again within a run.
///
/// - Late loops: what all programs together have added to the mean age of a message, if it had come
///   by way of all of them, is more than kMostLateness.
///
/// While the watch itself was suspended (two updates more than kSilence apart), no program counts
/// as silent.
class RunWatch {
 public:
  static constexpr Duration kSilence = std::chrono::milliseconds{1500};
  static constexpr Duration kPatience = std::chrono::seconds{5};

  /// In real time the world moves in steps of this, so that no age is known better.
  static constexpr Duration kMostLateness = std::chrono::milliseconds{5};

  RunWatch(std::int64_t run, std::string host, double rate)
      : run_(run), host_(std::move(host)), rate_(rate) {}

  /// A program of this run was started as this process; its former process is gone.
  void started(Instant now, const std::string& program, std::int64_t pid);
  /// It has ended, and is not expected to be heard.
  void ended(const std::string& program);
  /// It hangs, and is being ended.
  void given_up(Instant now, const std::string& program);
  /// A message on RUN/PRESENCE, who sent it (Message::sender; 0: not known), and whether that is an
  /// address of this host. The name of a host proves nothing.
  void heard(Instant now, const presence_t& presence, std::uint64_t sender = 0,
             bool from_this_host = true);
  /// A message on a channel on which only programs with a presence send.
  void sent(Instant now, const std::string& channel, std::uint64_t sender);
  /// A message on a channel of an external controller, which has no presence.
  void sent_by_controller(Instant now, const std::string& channel, std::uint64_t sender);
  /// The run is over: who has not said by now what it is was no program of it.
  void end(Instant now);
  /// A program's lateness so far, integrated over the time (RealTimeLoop::lateness_s2()), in µs·s.
  /// It begins at 0 again where a program was restarted.
  void late(const std::string& program, std::int64_t us_s);
  /// The finding on late loops of a run that has taken this time; "" if they were not late.
  std::string lateness(Duration run) const;
  /// Reports channels on which several programs send (SoleSender). Omitted if known unknown senders
  /// explain it.
  void several_senders(Instant now, const std::string& line);
  /// Regularly, several times a second.
  void update(Instant now);

  /// Own programs that hang now, and for how long (wall clock).
  std::vector<std::pair<std::string, Duration>> hung(Instant now) const;
  /// Whether this program has hung for longer than this.
  bool hangs(const std::string& program, Instant now, Duration for_so_long) const;

  /// All that makes the run invalid, in order; each once, with the time at which it was noticed.
  const std::vector<std::string>& findings() const { return findings_; }

 private:
  struct Own {
    std::int64_t pid = -1;
    std::uint16_t port = 0;  ///< port of its presence; its address may change with an interface
    Instant heard{};         ///< or the end of its time to start, less kSilence
    bool reported = false;
  };
  void heard_of_other_run(Instant now, const presence_t& presence);
  Duration silence(const Own& own, Instant now) const;
  void find(Instant now, const std::string& what);
  void judge_senders(Instant now, Instant since);
  void name(std::uint64_t sender);

  std::int64_t run_;
  std::string host_;
  double rate_;
  std::map<std::string, Own> own_;
  struct Former {
    std::string program;
    std::int64_t pid;
    std::uint16_t port;  ///< the same as in Own
  };
  std::vector<Former> former_;  ///< processes of this run that have ended
  std::vector<std::int64_t> other_runs_;
  struct Unnamed {
    std::string channel;
    Instant since;
  };
  struct Late {
    std::int64_t before_us_s = 0, newest_us_s = 0;
  };
  std::map<std::string, Late> late_;
  std::map<std::uint64_t, Unnamed> unnamed_;  ///< senders that have no presence yet
  std::set<std::uint64_t> named_;
  std::map<std::string, std::uint64_t> controllers_;  ///< who sent first on each of their channels
  bool has_unknown_senders_ = false;
  std::vector<std::string> known_;  ///< found, without their times
  std::vector<std::string> findings_;
  std::optional<Instant> updated_;
};

/// "tether-sim of AGV, process 4711 on host floor3".
std::string describe(const presence_t& presence);

}  // namespace tether
