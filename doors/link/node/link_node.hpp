#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <tether/peer_report_t.hpp>
#include <utility>
#include <vector>

#include "common/base/say.hpp"
#include "common/base/time.hpp"
#include "common/lcm/udpm_bus.hpp"
#include "common/node/bus.hpp"
#include "common/node/event_loop.hpp"
#include "common/node/node.hpp"
#include "doors/link/node/config.hpp"
#include "doors/link/sessions.hpp"

namespace tether::link {

/// Status of a peer in lines for the log: whether it is connected, by which paths, or the probable
/// reason why not and the remedy. The lines contain no byte from an unauthenticated sender.
class Diagnosis {
 public:
  /// Time before a missing peer is reported. A lost peer is reported at once.
  static constexpr Duration kPatience = std::chrono::seconds{5};

  explicit Diagnosis(std::string peer) : peer_(std::move(peer)) {}

  struct Sight {
    std::vector<std::string> alive;  ///< names of the paths
    std::vector<std::string> dead;
    std::vector<std::string> narrow;  ///< alive, but nothing as long as the mtu comes through
    std::size_t mtu = 0;
    bool crossed = false;  ///< its PROBEs come by the other path
    Refusals refused;
    double clock_ahead_s = 0.0;   ///< lead in the newest HELLO that was refused for it
    double clock_offset_s = 0.0;  ///< lower bound, as the session has measured it
    double clock_warning_s = 0.05;
    double clock_limit_s = 0.2;  ///< from there on, messages for a time are refused
  };
  struct Line {
    Severity severity;
    std::string text;
  };
  /// Now; called several times a second. nullopt: nothing new.
  std::optional<Line> look(Instant now, const Sight& sight);

 private:
  std::string how_up(const Sight& sight);
  std::string why_down(const Sight& sight);
  std::string clocks_apart(double ahead_s);
  std::string clocks_differ(const Sight& sight);

  std::string peer_;
  std::optional<Instant> since_;  // looked at without seeing it
  Refusals then_;                 // when that began
  double ahead_said_s_ = 0.0;
  double differ_said_s_ = 0.0;  // 0: they do not
  bool was_up_ = false;
  std::string said_;
};

/// Nanoseconds since 1970.
std::int64_t wall_ns();

/// One path's UDP socket. Never fragments IP packets.
///
/// An interface may go and come: a modem that is unplugged, a radio that is started late. Until it,
/// or the address to bind to, is there, the socket is closed and nothing is sent. A socket is bound
/// to the interface that there was, not to one of its name that comes later, and must therefore be
/// reopened.
class PathSocket {
 public:
  /// Throws std::runtime_error that names path, address and remedy for what no time will mend.
  explicit PathSocket(const PathConfig& config);
  ~PathSocket();
  PathSocket(const PathSocket&) = delete;
  PathSocket& operator=(const PathSocket&) = delete;

  int fd() const { return fd_; }  ///< −1: closed
  /// Why it is closed; empty: it is open.
  const std::string& trouble() const { return trouble_; }
  /// False: the interface is not what it was, or may be there now. Then reopen().
  bool is_current() const;
  void reopen();
  /// False, and counted: the system refused it.
  bool send(const Address& to, ByteView datagram);
  /// Hands over what is waiting, one batch at most, with the time at which the kernel got it. Too
  /// long ones are handed over cut, and do not authenticate.
  void receive(const std::function<void(const Address& from, ByteView datagram,
                                        std::int64_t arrival_ns)>& take);

  std::int64_t unsent() const { return unsent_; }
  std::int64_t dropped() const;
  /// Whether a datagram was too long for the interface, since the last call.
  bool take_too_long() { return std::exchange(too_long_, false); }

 private:
  /// False: trouble_ says why, errno what the system said.
  bool open();
  bool fail(const std::string& what);
  void shut();

  PathConfig config_;
  int fd_ = -1;
  unsigned interface_index_ = 0;
  std::string trouble_;
  std::int64_t dropped_before_ = 0;  // by sockets that are closed
  std::int64_t unsent_ = 0;
  bool too_long_ = false;
  DatagramBatch batch_;
};

inline constexpr char kReportChannel[] = "LINK/REPORT";
inline constexpr char kFatesChannel[] = "LINK/FATES";

/// LCM on one side, UDP to other hosts on the other. What comes from a peer is published, and not
/// heard here again, so that nothing goes round; LINK/… never leaves the host.
class LinkNode final : public Node {
 public:
  using Say = std::function<void(Severity severity, const std::string& line)>;

  /// `bus` must not hear itself. `say`: prints a line for the operator. Throws as PathSocket and
  /// Endpoint do.
  LinkNode(LinkConfig config, const KeyPair& own, EventLoop& loop, Bus& bus,
           const RandomKey& random, Say say);
  ~LinkNode() override;

  void finish() override {
    report();
    tell_fates();
  }

 private:
  Moment moment() const { return {loop_.now(), wall_ns()}; }
  void on_message(const Message& message);
  void on_readable(std::size_t path);
  void report();
  void report_peer(std::size_t number);
  void report_path(PeerLink& peer, std::size_t path, const std::optional<IntervalNs>& offset,
                   peer_report_t& out);
  void tell_fates();
  void tell_fates_of(std::size_t peer, std::size_t path);
  void open_path(std::size_t path);
  void renew_paths();
  void diagnose();

  LinkConfig config_;
  EventLoop& loop_;
  Bus& bus_;
  Say say_;
  std::deque<PathSocket> sockets_;
  Endpoint endpoint_;
  std::vector<Diagnosis> diagnoses_;
  std::vector<std::optional<Instant>> too_long_;  // by path, when it was noticed last
  bool copies_scheduled_ = false;
  std::int64_t seq_ = 0;
  std::int64_t fates_seq_ = 0;
};

}  // namespace tether::link
