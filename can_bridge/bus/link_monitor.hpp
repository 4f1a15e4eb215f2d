#pragma once

#include <optional>
#include <string>

namespace tether {

/// A network interface as the kernel's rtnetlink describes it (man 7 rtnetlink).
struct CanLink {
  /// State that a CAN controller reports (linux/can/netlink.h, IFLA_CAN_STATE).
  enum class Controller {
    none,  ///< the interface has no controller: vcan, vxcan
    active,
    passive,
    bus_off,
    stopped,
  };
  int index = 0;    ///< a new one for each interface that is created, whatever its name
  bool up = false;  ///< administratively
  Controller controller = Controller::none;
};

/// Asks and tells the kernel about one network interface, by name, and learns of its changes.
///
/// Asking and telling wait for other changes of links that are under way on this machine; taking up
/// or down waits for the adapter: usually far below a millisecond, with a dead serial or USB
/// adapter seconds.
class CanLinkMonitor {
 public:
  explicit CanLinkMonitor(std::string interface);
  ~CanLinkMonitor();
  CanLinkMonitor(const CanLinkMonitor&) = delete;
  CanLinkMonitor& operator=(const CanLinkMonitor&) = delete;

  /// nullopt: there is no such interface.
  std::optional<CanLink> query() const;

  /// Readable when a link of this machine may have changed: then call drain().
  int fd() const { return events_fd_; }

  /// Changes of an interface; it may be over already.
  struct Changes {
    bool deleted = false;
    bool was_down = false;
  };
  /// Reads all that is readable, and returns what it says of the interface of that index.
  Changes drain(int index) const;

  /// Takes the interface up or down; needs CAP_NET_ADMIN. 0, or the errno why not.
  int set_up(int index, bool up) const;
  /// Whether set_up() is permitted; changes nothing.
  bool may_change(int index) const;

 private:
  int change(int index, unsigned int flags, unsigned int which) const;

  std::string interface_;
  int events_fd_ = -1;
  int request_fd_ = -1;
};

}  // namespace tether
