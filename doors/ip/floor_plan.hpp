#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "doors/ip/ip_header.hpp"

namespace tether::ip {

/// Hosts of a floor and where packets between them go. Host 0 is the control room, host n the n-th
/// vehicle. All are in 10.67.0.0/16: the control room is 10.67.0.1, the first vehicle 10.67.1.1,
/// the 255th 10.67.2.1.
class FloorPlan {
 public:
  static constexpr std::size_t kControl = 0;
  static constexpr const char* kControlName = "control";

  /// Next step of a packet.
  enum class Next { one, all, nowhere };
  struct Route {
    Next next = Next::nowhere;
    std::size_t host = 0;  ///< with `one`
  };

  /// At most 1000 vehicles. Throws UsageError for a name that is not a host name, or that occurs
  /// twice: letters of ASCII, digits and '-', case does not count.
  explicit FloorPlan(const std::vector<std::string>& vehicles);

  std::size_t size() const { return names_.size(); }
  const std::string& name(std::size_t host) const { return names_.at(host); }
  static Address address(std::size_t host);

  /// Where a packet for `destination` goes that `from` has sent: to another host; to all others
  /// (multicast and broadcast); or nowhere, if no other host has this address.
  Route route(std::size_t from, Address destination) const;

  /// Lines of /etc/hosts.
  std::string hosts_file() const;

 private:
  std::vector<std::string> names_;
};

}  // namespace tether::ip
