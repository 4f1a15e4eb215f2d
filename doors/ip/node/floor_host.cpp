#include "doors/ip/node/floor_host.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <linux/if_tun.h>
#include <net/if.h>
#include <net/route.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/mount.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstring>
#include <stdexcept>
#include <string>

#include "common/base/errors.hpp"

namespace tether::ip {
namespace {

constexpr char kDevice[] = "tether0";
constexpr std::size_t kLongestPacket = 65'536;

sockaddr address_of(Address address) {
  sockaddr_in in{};
  in.sin_family = AF_INET;
  in.sin_addr.s_addr = htonl(address);
  sockaddr out{};
  std::memcpy(&out, &in, sizeof out);
  return out;
}

ifreq request_for(const char* device) {
  ifreq request{};
  std::strncpy(request.ifr_name, device, IFNAMSIZ - 1);
  return request;
}

void raise_interface(int socket, const char* device) {
  ifreq request = request_for(device);
  request.ifr_flags = IFF_UP | IFF_RUNNING;
  check_system_call(fmt::format("raising {}", device), ioctl(socket, SIOCSIFFLAGS, &request));
}

void write_file(const char* file, const std::string& text) {
  const int fd =
      check_system_call(std::string("opening ") + file, open(file, O_WRONLY | O_CLOEXEC));
  const auto written = write(fd, text.data(), text.size());
  const int error = errno;
  close(fd);
  if (written < 0) {
    throw std::system_error(error, std::generic_category(), std::string("writing ") + file);
  }
}

int make_tun(const FloorHost::Settings& settings) {
  const int tun = check_system_call(
      "opening /dev/net/tun (load the kernel's module: modprobe tun; in a container, pass the "
      "device)",
      open("/dev/net/tun", O_RDWR | O_CLOEXEC | O_NONBLOCK));
  ifreq request = request_for(kDevice);
  request.ifr_flags = IFF_TUN | IFF_NO_PI;
  check_system_call("making a TUN device", ioctl(tun, TUNSETIFF, &request));

  const int socket =
      check_system_call("opening a socket", ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  request = request_for(kDevice);
  request.ifr_mtu = settings.mtu;
  check_system_call("setting the MTU", ioctl(socket, SIOCSIFMTU, &request));
  request = request_for(kDevice);
  request.ifr_addr = address_of(settings.address);
  check_system_call("setting the address", ioctl(socket, SIOCSIFADDR, &request));
  request.ifr_netmask = address_of(0xffff0000U);
  check_system_call("setting the netmask", ioctl(socket, SIOCSIFNETMASK, &request));
  raise_interface(socket, "lo");
  raise_interface(socket, kDevice);
  char device[sizeof kDevice];
  std::memcpy(device, kDevice, sizeof device);
  rtentry multicast{};
  multicast.rt_dst = address_of(0xe0000000U);
  multicast.rt_genmask = address_of(0xf0000000U);
  multicast.rt_flags = RTF_UP;
  multicast.rt_dev = device;
  check_system_call("adding the multicast route", ioctl(socket, SIOCADDRT, &multicast));
  close(socket);
  return tun;
}

/// On success `fd` travels along.
void send_result(int socket, const std::string& error, int fd) {
  std::string text = error.empty() ? "+" : error;
  iovec data{text.data(), text.size()};
  alignas(cmsghdr) char control[CMSG_SPACE(sizeof(int))] = {};
  msghdr message{};
  message.msg_iov = &data;
  message.msg_iovlen = 1;
  if (fd >= 0) {
    message.msg_control = control;
    message.msg_controllen = sizeof control;
    cmsghdr* const head = CMSG_FIRSTHDR(&message);
    head->cmsg_level = SOL_SOCKET;
    head->cmsg_type = SCM_RIGHTS;
    head->cmsg_len = CMSG_LEN(sizeof(int));
    std::memcpy(CMSG_DATA(head), &fd, sizeof fd);
  }
  sendmsg(socket, &message, MSG_NOSIGNAL);
}

int receive_result(int socket) {
  char text[1024] = {};
  iovec data{text, sizeof text - 1};
  alignas(cmsghdr) char control[CMSG_SPACE(sizeof(int))] = {};
  msghdr message{};
  message.msg_iov = &data;
  message.msg_iovlen = 1;
  message.msg_control = control;
  message.msg_controllen = sizeof control;
  const auto bytes = recvmsg(socket, &message, MSG_CMSG_CLOEXEC);
  const cmsghdr* const head = CMSG_FIRSTHDR(&message);
  if (bytes <= 0) throw std::runtime_error("a host of the floor ended while it was made");
  if (head == nullptr) throw std::runtime_error(text);
  int fd = -1;
  std::memcpy(&fd, CMSG_DATA(head), sizeof fd);
  return fd;
}

/// Life of a host's first process, which never returns. Its only descriptor is `life`.
[[noreturn]] void be_host(const FloorHost::Settings& settings, int life, uid_t user, gid_t group,
                          bool maps_user) {
  try {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    prctl(PR_SET_NAME, "tether-host");
    std::signal(SIGCHLD, SIG_IGN);  // NOLINT(cert-err33-c): orphans have no parent that waits
    if (maps_user) {
      write_file("/proc/self/setgroups", "deny");
      write_file("/proc/self/uid_map", fmt::format("0 {} 1", user));
      write_file("/proc/self/gid_map", fmt::format("0 {} 1", group));
    }
    check_system_call("making mounts private",
                      mount(nullptr, "/", nullptr, MS_REC | MS_PRIVATE, nullptr));
    check_system_call("mounting /etc/hosts",
                      mount(settings.hosts_file.c_str(), "/etc/hosts", nullptr, MS_BIND, nullptr));
    // Containers may forbid it; then `ps` on the host sees the outer processes.
    mount("proc", "/proc", "proc", MS_NOSUID | MS_NODEV | MS_NOEXEC, nullptr);
    const int tun = make_tun(settings);
    send_result(life, "", tun);
    close(tun);  // only tether-tun keeps the device
  } catch (const std::exception& error) {
    send_result(life, error.what(), -1);
    _exit(1);
  }
  char byte = 0;
  while (read(life, &byte, 1) < 0 && errno == EINTR) {
  }
  _exit(0);
}

}  // namespace

FloorHost::FloorHost(const Settings& settings) {
  int ends[2];
  check_system_call("making a pair of sockets",
                    socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends));
  const uid_t user = geteuid();
  const gid_t group = getegid();
  const bool maps_user = user != 0;
  const unsigned long flags = static_cast<unsigned long>(CLONE_NEWNET | CLONE_NEWNS | CLONE_NEWPID |
                                                         (maps_user ? CLONE_NEWUSER : 0) | SIGCHLD);
  process_ = static_cast<pid_t>(syscall(SYS_clone, flags, nullptr, nullptr, nullptr, nullptr));
  if (process_ == 0) {
    constexpr int kLife = 3;
    dup2(ends[1], kLife);
    close_range(kLife + 1, ~0U, 0);
    be_host(settings, kLife, user, group, maps_user);
  }
  const int error = errno;
  close(ends[1]);
  life_ = ends[0];
  if (process_ < 0) {
    close(life_);
    throw std::runtime_error(
        fmt::format("the kernel allows no namespaces: {}: run as root, or allow them: sysctl "
                    "user.max_user_namespaces=10000 kernel.unprivileged_userns_clone=1",
                    std::strerror(error)));
  }
  try {
    tun_ = receive_result(life_);
  } catch (const std::exception& why) {
    close(life_);
    waitpid(process_, nullptr, 0);
    throw std::runtime_error(fmt::format("host {}: {}", settings.name, why.what()));
  }
}

FloorHost::~FloorHost() {
  close(tun_);
  close(life_);
  kill(process_, SIGKILL);
  waitpid(process_, nullptr, 0);
}

void FloorHost::read_packets(int most,
                             const std::function<void(std::vector<std::uint8_t>)>& take) const {
  static std::vector<std::uint8_t> buffer(kLongestPacket);
  for (int i = 0; i < most; ++i) {
    const auto bytes = read(tun_, buffer.data(), buffer.size());
    if (bytes <= 0) return;
    take({buffer.begin(), buffer.begin() + bytes});
  }
}

bool FloorHost::write_packet(const std::vector<std::uint8_t>& packet) const {
  return write(tun_, packet.data(), packet.size()) == static_cast<ssize_t>(packet.size());
}

}  // namespace tether::ip
