#include "common/bus/message_digest.hpp"

#include <boost/crc.hpp>

namespace tether {

MessageDigest digest_of(std::span<const std::uint8_t> bytes) {
  boost::crc_32_type crc;
  crc.process_bytes(bytes.data(), bytes.size());
  return {static_cast<std::int64_t>(bytes.size()), crc.checksum()};
}

}  // namespace tether
