#pragma once

#include <cstdint>
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

/// `none` only asks whether changes are permitted.
enum class LinkChange : std::uint8_t { none, down, up };

/// Queries and changes network interfaces by rtnetlink.
///
/// All calls wait for other changes of links that are under way on this machine. A change waits for
/// the adapter: usually far below a millisecond, with a dead serial or USB adapter seconds.
/// All throw std::system_error for failures of rtnetlink itself.
class CanLinkControl {
 public:
  CanLinkControl();
  ~CanLinkControl();
  CanLinkControl(const CanLinkControl&) = delete;
  CanLinkControl& operator=(const CanLinkControl&) = delete;

  /// nullopt: the interface does not exist.
  std::optional<CanLink> query(const std::string& interface) const;

  /// Whether the interface of that index exists and is one of CAN.
  bool is_can(int index) const;

  /// Returns 0, or the errno of the failure: EPERM without CAP_NET_ADMIN.
  int change(int index, LinkChange change) const;

 private:
  int fd_ = -1;
};

}  // namespace tether
