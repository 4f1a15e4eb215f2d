#include "common/lcm/lcm_datagrams.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <iterator>

namespace tether {
namespace {

constexpr std::uint32_t kShortMagic = 0x4c433032;     // "LC02"
constexpr std::uint32_t kFragmentMagic = 0x4c433033;  // "LC03"
constexpr std::size_t kShortHeader = 8, kFragmentHeader = 20;
constexpr std::size_t kMaxShort = 65499;     // channel, its NUL and bytes
constexpr std::size_t kMaxFragment = 65487;  // the same, of a fragment
constexpr std::size_t kMaxFragments = 65535;

std::uint32_t read(std::span<const std::uint8_t> from, std::size_t at, std::size_t size) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < size; ++i) value = value << 8 | from[at + i];
  return value;
}

/// A datagram's header, the channel's name with it.
class Header {
 public:
  void put(std::uint32_t value, std::size_t size) {
    for (std::size_t i = size; i-- > 0;) {
      bytes_[size_++] = static_cast<std::uint8_t>(value >> (8 * i));
    }
  }
  void put_name(std::string_view name) {
    std::copy(name.begin(), name.end(), bytes_.begin() + static_cast<std::ptrdiff_t>(size_));
    size_ += name.size();
    bytes_[size_++] = 0;
  }
  std::span<const std::uint8_t> bytes() const { return {bytes_.data(), size_}; }

 private:
  std::array<std::uint8_t, kFragmentHeader + kMaxChannelBytes + 1> bytes_{};
  std::size_t size_ = 0;
};

/// Splits a name from what follows its NUL; nullopt without one, or if the name is too long.
std::optional<std::string_view> take_name(std::span<const std::uint8_t>& rest) {
  const auto* begin = reinterpret_cast<const char*>(rest.data());
  const std::size_t length = strnlen(begin, std::min(rest.size(), kMaxChannelBytes + 1));
  if (length == rest.size() || length > kMaxChannelBytes) return std::nullopt;
  rest = rest.subspan(length + 1);
  return std::string_view(begin, length);
}

}  // namespace

bool make_lcm_datagrams(std::uint32_t number, std::string_view channel,
                        std::span<const std::uint8_t> bytes, const SendDatagram& send) {
  const std::size_t whole = channel.size() + 1 + bytes.size();
  const std::size_t count = (whole + kMaxFragment - 1) / kMaxFragment;
  if (channel.size() > kMaxChannelBytes || count > kMaxFragments) return false;
  if (whole <= kMaxShort) {
    Header header;
    header.put(kShortMagic, 4);
    header.put(number, 4);
    header.put_name(channel);
    send(header.bytes(), bytes);
    return true;
  }
  std::size_t offset = 0;
  for (std::size_t i = 0; i < count; ++i) {
    Header header;
    header.put(kFragmentMagic, 4);
    header.put(number, 4);
    header.put(static_cast<std::uint32_t>(bytes.size()), 4);
    header.put(static_cast<std::uint32_t>(offset), 4);
    header.put(static_cast<std::uint32_t>(i), 2);
    header.put(static_cast<std::uint32_t>(count), 2);
    if (i == 0) header.put_name(channel);
    const std::size_t room = i == 0 ? kMaxFragment - channel.size() - 1 : kMaxFragment;
    const std::size_t size = std::min(room, bytes.size() - offset);
    send(header.bytes(), bytes.subspan(offset, size));
    offset += size;
  }
  return true;
}

struct LcmAssembler::Fragment {
  explicit Fragment(std::span<const std::uint8_t> datagram)
      : size(read(datagram, 8, 4)),
        offset(read(datagram, 12, 4)),
        number(read(datagram, 16, 2)),
        count(read(datagram, 18, 2)),
        bytes(datagram.subspan(kFragmentHeader)) {}

  bool is_possible() const {
    return number < count && size <= kMaxBytes && size <= count * kMaxShort && offset <= size &&
           bytes.size() <= size - offset;
  }

  std::size_t size;
  std::size_t offset;
  std::size_t number;
  std::size_t count;
  std::span<const std::uint8_t> bytes;
};

std::optional<Message> LcmAssembler::take(std::uint64_t sender,
                                          std::span<const std::uint8_t> datagram) {
  if (datagram.size() >= kShortHeader && read(datagram, 0, 4) == kShortMagic) {
    return take_short(sender, datagram);
  }
  if (datagram.size() >= kFragmentHeader && read(datagram, 0, 4) == kFragmentMagic) {
    return take_fragment(sender, datagram);
  }
  return malformed();
}

std::optional<Message> LcmAssembler::take_short(std::uint64_t sender,
                                                std::span<const std::uint8_t> datagram) {
  std::span<const std::uint8_t> rest = datagram.subspan(kShortHeader);
  const std::optional<std::string_view> name = take_name(rest);
  if (!name) return malformed();
  return Message{*name, rest, sender};
}

std::optional<Message> LcmAssembler::take_fragment(std::uint64_t sender,
                                                   std::span<const std::uint8_t> datagram) {
  Fragment fragment(datagram);
  std::optional<std::string_view> name;
  if (fragment.number == 0) {
    name = take_name(fragment.bytes);
    if (!name) return malformed();
  }
  if (!fragment.is_possible()) return malformed();

  const Key key{sender, read(datagram, 4, 4)};
  Partial& message = partial(key, fragment);
  if (message.bytes.size() != fragment.size || message.has.size() != fragment.count) {
    return malformed();
  }
  if (message.has[fragment.number]) return std::nullopt;
  message.has[fragment.number] = true;
  if (name) message.channel.emplace(*name);
  std::copy(fragment.bytes.begin(), fragment.bytes.end(),
            message.bytes.begin() + static_cast<std::ptrdiff_t>(fragment.offset));
  if (--message.missing > 0) return std::nullopt;

  channel_ = *message.channel;
  bytes_.swap(message.bytes);
  pending_bytes_ -= bytes_.size();
  ages_.erase(message.age);
  pending_.erase(key);
  return Message{channel_, bytes_, sender};
}

LcmAssembler::Partial& LcmAssembler::partial(const Key& key, const Fragment& fragment) {
  const auto found = pending_.find(key);
  if (found != pending_.end()) return found->second;
  while (!ages_.empty() &&
         (pending_.size() >= kMaxPending || pending_bytes_ + fragment.size > kMaxBytes)) {
    give_up(pending_.find(ages_.front()));
  }
  ages_.push_back(key);
  pending_bytes_ += fragment.size;
  return pending_
      .emplace(key, Partial{{},
                            std::vector<std::uint8_t>(fragment.size),
                            std::vector<bool>(fragment.count),
                            fragment.count,
                            std::prev(ages_.end())})
      .first->second;
}

void LcmAssembler::give_up(std::map<Key, Partial>::iterator found) {
  ++counters_.incomplete;
  pending_bytes_ -= found->second.bytes.size();
  ages_.erase(found->second.age);
  pending_.erase(found);
}

std::optional<Message> LcmAssembler::malformed() {
  ++counters_.malformed;
  return std::nullopt;
}

}  // namespace tether
