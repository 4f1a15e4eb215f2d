#include "can_bridge/bus/link_service.hpp"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cassert>
#include <cerrno>
#include <cstring>
#include <utility>

#include "common/base/errors.hpp"

namespace tether {
namespace {

sockaddr_un address_of(const std::string& path) {
  sockaddr_un address{};
  assert(path.size() < sizeof address.sun_path);
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, path.c_str(), path.size() + 1);
  return address;
}

bool connect_to(int fd, const std::string& path) {
  const sockaddr_un address = address_of(path);
  return connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
}

int open_socket(int flags) { return socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | flags, 0); }

}  // namespace

CanLinkService::CanLinkService(std::string path, EventLoop& loop)
    : path_(std::move(path)), loop_(loop) {
  const int fd = check_system_call("opening a socket", open_socket(SOCK_NONBLOCK));
  unlink(path_.c_str());
  const sockaddr_un address = address_of(path_);
  constexpr int kWaiting = 8;
  if (bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
      listen(fd, kWaiting) != 0) {
    const int error = errno;
    close(fd);
    errno = error;
    check_system_call("listening at " + path_, -1);
  }
  listener_ = fd;
  loop_.add_fd(listener_, [this](Instant) { accept_one(); });
}

CanLinkService::~CanLinkService() {
  loop_.remove_fd(listener_);
  close(listener_);
  unlink(path_.c_str());
}

void CanLinkService::accept_one() {
  const int client = accept4(listener_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
  if (client < 0) return;  // it has gone again
  loop_.add_fd(client, [this, client](Instant) { answer(client); });
}

void CanLinkService::answer(int client) {
  CanLinkRequest request;
  const ssize_t size = recv(client, &request, sizeof request, MSG_TRUNC);
  if (size < 0 && (errno == EAGAIN || errno == EINTR)) return;
  if (size > 0) {
    std::int32_t error = EINVAL;
    if (size == sizeof request && request.change <= LinkChange::up) {
      error =
          control_.is_can(request.index) ? control_.change(request.index, request.change) : EACCES;
    }
    (void)send(client, &error, sizeof error, MSG_NOSIGNAL);  // or it no longer waits
  }
  loop_.remove_fd(client);
  close(client);
}

int ask_can_link_service(const std::string& path, int index, LinkChange change) {
  const int fd = open_socket(0);
  if (fd < 0) return EPERM;
  std::int32_t error = EPERM;
  if (connect_to(fd, path)) {
    const CanLinkRequest request{.index = index, .change = change};
    error = EIO;
    if (send(fd, &request, sizeof request, MSG_NOSIGNAL) == sizeof request) {
      ssize_t size = -1;
      std::int32_t said = EIO;
      do {
        size = recv(fd, &said, sizeof said, 0);
      } while (size < 0 && errno == EINTR);
      if (size == sizeof said) error = said;
    }
  }
  close(fd);
  return error;
}

}  // namespace tether
