#include "common/lcm/datagram_batch.hpp"

#include <cstring>
#include <ctime>

namespace tether {
namespace {

constexpr std::size_t kDatagramBytes = 65536;  // the longest of UDP has 65507

}  // namespace

DatagramBatch::DatagramBatch() : bytes_(kDatagrams * kDatagramBytes) {
  for (std::size_t i = 0; i < kDatagrams; ++i) {
    parts_[i] = {bytes_.data() + i * kDatagramBytes, kDatagramBytes};
    messages_[i].msg_hdr.msg_iov = &parts_[i];
    messages_[i].msg_hdr.msg_iovlen = 1;
    messages_[i].msg_hdr.msg_name = &senders_[i];
    messages_[i].msg_hdr.msg_control = &arrivals_[i];
  }
}

int DatagramBatch::receive(int fd) {
  for (mmsghdr& m : messages_) {
    m.msg_hdr.msg_namelen = sizeof(sockaddr_in);
    m.msg_hdr.msg_controllen = sizeof(Arrival);
  }
  return recvmmsg(fd, messages_.data(), kDatagrams, MSG_DONTWAIT, nullptr);
}

std::optional<std::int64_t> DatagramBatch::arrival_ns(std::size_t i) const {
  const cmsghdr& note = arrivals_[i].note;
  if (messages_[i].msg_hdr.msg_controllen < sizeof(cmsghdr) || note.cmsg_type != SCM_TIMESTAMPNS) {
    return std::nullopt;
  }
  timespec time{};
  std::memcpy(&time, CMSG_DATA(&note), sizeof time);
  return time.tv_sec * 1'000'000'000LL + time.tv_nsec;
}

std::span<const std::uint8_t> DatagramBatch::datagram(std::size_t i) const {
  return {bytes_.data() + i * kDatagramBytes, messages_[i].msg_len};
}

}  // namespace tether
