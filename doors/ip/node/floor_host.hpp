#pragma once

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "doors/ip/ip_header.hpp"

namespace tether::ip {

/// A host of a floor: a process with network, mount and process namespaces of its own, where the
/// TUN device `tether0` is the only interface beside loopback. Where this process is not root, also
/// a user namespace. The kernel ends all that runs on the host when this process ends, however it
/// ends, and removes the device.
class FloorHost {
 public:
  struct Settings {
    std::string name;
    Address address = 0;
    int mtu = 1500;
    std::filesystem::path hosts_file;  ///< the host's /etc/hosts
  };

  /// Call it while this process has one thread. Throws std::runtime_error, which says what to do,
  /// where the kernel allows no namespaces or TUN devices.
  explicit FloorHost(const Settings& settings);
  FloorHost(const FloorHost&) = delete;
  FloorHost& operator=(const FloorHost&) = delete;
  /// Ends the host.
  ~FloorHost();

  pid_t process() const { return process_; }
  /// Readable when the host has sent a packet; does not block.
  int tun() const { return tun_; }

  /// Hands over what the host has sent, at most `most` packets, so that other work has its turn.
  void read_packets(int most, const std::function<void(std::vector<std::uint8_t>)>& take) const;
  /// Whether the host took the packet.
  bool write_packet(const std::vector<std::uint8_t>& packet) const;

 private:
  pid_t process_ = -1;
  int life_ = -1;  ///< the host ends when this is closed
  int tun_ = -1;
};

}  // namespace tether::ip
