#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <utility>

#include "common/lcm/datagram_batch.hpp"
#include "link/node/config.hpp"

namespace tether::link {

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

}  // namespace tether::link
