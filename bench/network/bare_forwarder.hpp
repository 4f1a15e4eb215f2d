#pragma once

#include <netinet/in.h>

#include <string>
#include <thread>

namespace tether::bench {

/// The lower bound for a relay: passes datagrams from one UDP multicast network to another as they
/// are, as many per system call as are waiting, in a thread of its own that does nothing else.
class BareForwarder {
 public:
  /// Both are checked udpm URLs. Throws std::runtime_error if the system refuses a socket.
  BareForwarder(const std::string& from, const std::string& to);
  ~BareForwarder();
  BareForwarder(const BareForwarder&) = delete;
  BareForwarder& operator=(const BareForwarder&) = delete;

 private:
  void run();

  int in_;
  int out_;
  sockaddr_in group_;  // to send to
  std::thread thread_;
};

}  // namespace tether::bench
