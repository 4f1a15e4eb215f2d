#include "doors/link/pieces.hpp"

#include <algorithm>
#include <cassert>
#include <utility>

namespace tether::link {

std::size_t cut(std::string_view channel, ByteView bytes, std::size_t datagram_bytes,
                const std::function<void(const Piece&)>& take) {
  assert(datagram_bytes >= kSmallestDatagram);
  if (channel.empty() || channel.size() > kMostChannelBytes ||
      channel.find('\0') != std::string_view::npos || bytes.size() > kMostMessageBytes) {
    return 0;
  }
  const std::size_t room = datagram_bytes - kSealedHeaderBytes - kTagBytes - kPieceHeaderBytes;
  const std::size_t first = std::min(bytes.size(), room - 1 - channel.size());
  const std::size_t count = 1 + (bytes.size() - first + room - 1) / room;
  if (count > kMostPieces) return 0;
  Piece piece;
  piece.count = static_cast<std::uint16_t>(count);
  for (std::size_t begin = 0, size = first; piece.number < count; ++piece.number) {
    piece.channel = piece.number == 0 ? channel : std::string_view{};
    piece.bytes = bytes.subspan(begin, size);
    take(piece);
    begin += size;
    size = std::min(room, bytes.size() - begin);
  }
  return count;
}

std::optional<Reassembly::Whole> Reassembly::take(Instant now, MessageNumber message,
                                                  const Piece& piece) {
  if (piece.count == 1) {
    channel_ = piece.channel;
    return Whole{message, channel_, piece.bytes};
  }
  const auto [found, is_new] = partials_.try_emplace(message);
  Partial& partial = found->second;
  if (is_new) {
    partial.begin = now;
    partial.pieces.resize(piece.count);
    partial.missing = piece.count;
  }
  // An honest peer says the same count each time, and no piece of a whole message is empty.
  const bool fits = partial.pieces.size() == piece.count && !piece.bytes.empty() &&
                    partial.pieces[piece.number].empty();
  if (!fits) {
    give_up(found);
    return std::nullopt;
  }
  if (piece.number == 0) partial.channel = piece.channel;
  partial.pieces[piece.number].assign(piece.bytes.begin(), piece.bytes.end());
  partial.bytes += piece.bytes.size();
  bytes_ += piece.bytes.size();
  if (--partial.missing > 0) {
    make_room(now);
    return std::nullopt;
  }
  channel_ = std::move(partial.channel);
  whole_.clear();
  for (const Bytes& part : partial.pieces) whole_.insert(whole_.end(), part.begin(), part.end());
  bytes_ -= partial.bytes;
  partials_.erase(found);
  if (whole_.size() > kMostMessageBytes) return std::nullopt;
  return Whole{message, channel_, whole_};
}

void Reassembly::give_up(Partials::iterator partial) {
  bytes_ -= partial->second.bytes;
  partials_.erase(partial);
  ++incomplete_;
}

void Reassembly::make_room(Instant now) {
  while (partials_.size() > kMostMessages || bytes_ > kMostBytes) give_up(partials_.begin());
  while (!partials_.empty() && now - partials_.begin()->second.begin > kPatience) {
    give_up(partials_.begin());
  }
}

void Reassembly::drop_older(std::string_view channel, MessageNumber than) {
  for (auto i = partials_.begin(); i != partials_.end() && i->first < than;) {
    const auto next = std::next(i);
    if (i->second.channel == channel) give_up(i);
    i = next;
  }
}

}  // namespace tether::link
