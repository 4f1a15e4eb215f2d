#pragma once

#include <cstdint>
#include <string>

#include "can_bridge/bus/link_control.hpp"
#include "common/node/event_loop.hpp"

namespace tether {

/// Where the CanLinkService of this machine listens (RuntimeDirectory= of its unit).
inline constexpr char kCanLinkService[] = "/run/tether-can-links/socket";

/// Takes CAN interfaces down and up for programs of this machine that lack CAP_NET_ADMIN, and does
/// nothing else with that capability: other interfaces, and what is not a request, are refused.
///
/// Every user who may write to the socket may ask, so its folder must be closed to others. Requests
/// are SOCK_SEQPACKET messages of one CanLinkRequest, one for each connection; the answer is an
/// errno, as std::int32_t. Runs as long as `loop` does.
class CanLinkService {
 public:
  /// Replaces a socket that an earlier service left. Throws std::system_error.
  CanLinkService(std::string path, EventLoop& loop);
  ~CanLinkService();
  CanLinkService(const CanLinkService&) = delete;
  CanLinkService& operator=(const CanLinkService&) = delete;

 private:
  void accept_one();
  void answer(int client);

  std::string path_;
  EventLoop& loop_;
  CanLinkControl control_;
  int listener_ = -1;
};

struct CanLinkRequest {
  std::int32_t index = 0;  ///< interface index
  LinkChange change = LinkChange::none;
  std::uint8_t zero[3] = {};
};

/// Asks the service at `path` for a change. 0, or the errno why it was not made: EPERM without a
/// service, EIO if it ended meanwhile. Waits as long as the service does (CanLinkControl).
int ask_can_link_service(const std::string& path, int index, LinkChange change);

}  // namespace tether
