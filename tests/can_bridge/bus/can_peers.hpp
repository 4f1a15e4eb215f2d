#pragma once

#include <fcntl.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <linux/tty.h>
#include <net/if.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

/// For tests of real CAN sockets: the others on the bus, written without the code under test.
namespace tether::test {

inline void must(bool ok, const std::string& what) {
  if (!ok) throw std::runtime_error(what + ": " + std::strerror(errno));
}

/// Runs a shell command that has to succeed.
inline void sh(const std::string& command) {
  must(std::system(("{ " + command + "; } >/dev/null").c_str()) == 0, command);
}

/// A raw CAN socket that hears everything, error and FD frames too, and sends anything.
class Peer {
 public:
  explicit Peer(const std::string& interface) : fd_(socket(AF_CAN, SOCK_RAW | SOCK_NONBLOCK, 1)) {
    must(fd_ >= 0, "socket");
    set(CAN_RAW_FD_FRAMES, 1);
    set(CAN_RAW_ERR_FILTER, CAN_ERR_MASK);
    sockaddr_can address{};
    address.can_family = AF_CAN;
    address.can_ifindex = static_cast<int>(if_nametoindex(interface.c_str()));
    must(bind(fd_, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0, "bind");
  }
  ~Peer() { close(fd_); }
  Peer(const Peer&) = delete;
  Peer& operator=(const Peer&) = delete;

  /// `id` with its flags. False: not taken.
  bool send(std::uint32_t id, std::vector<std::uint8_t> data = {}) {
    can_frame f{};
    f.can_id = id;
    f.can_dlc = static_cast<std::uint8_t>(data.size());
    std::copy(data.begin(), data.end(), f.data);
    return write(fd_, &f, sizeof f) == sizeof f;
  }
  void send_fd(std::uint32_t id, std::uint8_t size) {
    canfd_frame f{};
    f.can_id = id;
    f.len = size;
    must(write(fd_, &f, sizeof f) == sizeof f, "CAN FD write");
  }
  /// Everything that came and was not taken yet.
  std::vector<can_frame> take() {
    std::vector<can_frame> all;
    canfd_frame f{};
    while (read(fd_, &f, sizeof f) == CAN_MTU) {
      all.emplace_back();
      std::memcpy(&all.back(), &f, CAN_MTU);
    }
    return all;
  }

 private:
  void set(int option, std::uint32_t value) {
    must(setsockopt(fd_, SOL_CAN_RAW, option, &value, sizeof value) == 0, "setsockopt");
  }
  int fd_;
};

/// A serial-line CAN adapter: the kernel's slcan driver on one end of a pseudo terminal, this class
/// on the other. The kernel treats it as a CAN controller with error states and a queue.
class SerialAdapter {
 public:
  explicit SerialAdapter(const std::string& name) : name_(name) {
    must((master_ = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK)) >= 0, "posix_openpt");
    must(grantpt(master_) == 0 && unlockpt(master_) == 0, "unlockpt");
    must((slave_ = ::open(ptsname(master_), O_RDWR | O_NOCTTY)) >= 0, "opening the terminal");
    const int discipline = N_SLCAN;
    must(ioctl(slave_, TIOCSETD, &discipline) == 0, "the slcan line discipline");
    ifreq request{};
    must(ioctl(slave_, SIOCGIFNAME, &request) == 0, "the name of the slcan interface");
    // The driver makes it in the machine's first network: fetch it from there.
    sh(
        fmt::format("ip link show {0} 2>/dev/null || nsenter --net=/proc/1/ns/net ip link set {0} "
                    "netns {1}",
                    request.ifr_name, getpid()));
    sh(fmt::format("ip link set {} name {}", request.ifr_name, name));
    sh(fmt::format("ip link set {} type can bitrate 500000", name));
    reader_ = std::thread([this] { read_lines(); });  // it answers only if there is a listener
    const std::string up = fmt::format("ip link set {} up", name);
    if (std::system(up.c_str()) != 0) ADD_FAILURE() << up;
  }
  ~SerialAdapter() {
    stalled_ = false;
    ended_ = true;
    reader_.join();
    close(slave_);
    close(master_);
  }
  SerialAdapter(const SerialAdapter&) = delete;
  SerialAdapter& operator=(const SerialAdapter&) = delete;

  /// Report of the adapter on its controller: 'a'ctive, 'p'assive or 'b'us-off.
  void report(char state, int errors) {
    say(fmt::format("s{}{:03}{:03}\r", state, errors, errors));
  }
  /// A frame from the bus, such as "t2012AABB".
  void receive(const std::string& frame) { say(frame + "\r"); }
  /// From now on the adapter takes nothing any more, or takes everything again.
  void stall(bool stalled) { stalled_ = stalled; }
  /// The frames that reached the bus since the last call, as "t2012AABB".
  std::vector<std::string> take() {
    const std::lock_guard lock(mutex_);
    std::vector<std::string> taken;
    taken.swap(frames_);
    return taken;
  }

 private:
  void say(const std::string& text) {
    must(write(master_, text.data(), text.size()) == static_cast<ssize_t>(text.size()), "write");
  }
  void read_lines() {
    std::string line;
    while (!ended_) {
      pollfd p{master_, POLLIN, 0};
      if (stalled_ || poll(&p, 1, 5) <= 0) {
        if (stalled_) usleep(5000);
        continue;
      }
      char buffer[4096];
      const ssize_t size = read(master_, buffer, sizeof buffer);
      for (ssize_t i = 0; i < size; ++i) {
        if (buffer[i] != '\r') {
          line += buffer[i];
          continue;
        }
        const std::lock_guard lock(mutex_);
        if (!line.empty() && (line[0] == 't' || line[0] == 'T')) frames_.push_back(line);
        line.clear();
      }
    }
  }

  std::string name_;
  int master_ = -1;
  int slave_ = -1;
  std::atomic<bool> stalled_ = false;
  std::atomic<bool> ended_ = false;
  std::mutex mutex_;
  std::vector<std::string> frames_;
  std::thread reader_;
};

}  // namespace tether::test
