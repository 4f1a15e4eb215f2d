#pragma once

#include <optional>
#include <string>

#include "can_bridge/bus/link_control.hpp"

namespace tether {

/// Queries and changes one network interface, by name, and learns of its changes. A change that the
/// kernel does not permit to this program is made by the CanLinkService of this machine, if it
/// runs.
class CanLinkMonitor {
 public:
  /// `service`: the socket of the CanLinkService.
  CanLinkMonitor(std::string interface, std::string service);
  ~CanLinkMonitor();
  CanLinkMonitor(const CanLinkMonitor&) = delete;
  CanLinkMonitor& operator=(const CanLinkMonitor&) = delete;

  /// nullopt: there is no such interface.
  std::optional<CanLink> query() const { return control_.query(interface_); }

  /// Readable when a link of this machine may have changed: then call drain().
  int fd() const { return events_fd_; }

  /// Changes of an interface; it may be over already.
  struct Changes {
    bool deleted = false;
    bool was_down = false;
  };
  /// Reads all that is readable, and returns what it says of the interface of that index.
  Changes drain(int index) const;

  /// 0, or the errno why not: EPERM without CAP_NET_ADMIN and without a CanLinkService.
  int change(int index, LinkChange change) const;

 private:
  std::string interface_;
  std::string service_;
  CanLinkControl control_;
  int events_fd_ = -1;
};

}  // namespace tether
