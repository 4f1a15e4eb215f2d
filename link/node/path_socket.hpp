#pragma once

#include <cstdint>
#include <functional>

#include "common/lcm/datagram_batch.hpp"
#include "link/node/config.hpp"

namespace tether::link {

/// Nanoseconds since 1970.
std::int64_t wall_ns();

/// One path's UDP socket. Never fragments IP packets.
class PathSocket {
 public:
  /// Throws std::runtime_error that names path, address and remedy.
  explicit PathSocket(const PathConfig& config);
  ~PathSocket();
  PathSocket(const PathSocket&) = delete;
  PathSocket& operator=(const PathSocket&) = delete;

  int fd() const { return fd_; }
  /// False, and counted: the system refused it.
  bool send(const Address& to, ByteView datagram);
  /// Hands over what is waiting, one batch at most, with the time at which the kernel got it. Too
  /// long ones are handed over cut, and do not authenticate.
  void receive(const std::function<void(const Address& from, ByteView datagram,
                                        std::int64_t arrival_ns)>& take);

  std::int64_t unsent() const { return unsent_; }
  std::int64_t dropped() const;
  /// A datagram was too long for the network.
  bool too_long() const { return too_long_; }

 private:
  void open(const PathConfig& config);

  int fd_ = -1;
  std::int64_t unsent_ = 0;
  bool too_long_ = false;
  DatagramBatch batch_;
};

}  // namespace tether::link
