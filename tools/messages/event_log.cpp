#include "tools/messages/event_log.hpp"

#include <algorithm>
#include <optional>
#include <stdexcept>

namespace tether {
namespace {

constexpr std::uint32_t kMaxChannelBytes = 1000;
constexpr std::uint32_t kMaxDataBytes = 1U << 28;
constexpr std::size_t kChunkBytes = 1 << 16;

std::uint8_t magic_byte(std::size_t i) {
  return static_cast<std::uint8_t>(EventLogReader::kMagic >> (24 - 8 * i));
}

}  // namespace

// Makes `wanted` bytes from position_ on available, or as many as the file still has.
std::size_t EventLogReader::available(std::size_t wanted) {
  const std::size_t have = buffer_.size() - position_;
  if (have >= wanted || !in_) return std::min(wanted, have);
  if (position_ > 0) {
    buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(position_));
    base_ += position_;
    position_ = 0;
  }
  while (buffer_.size() < wanted && in_) {
    const std::size_t old_size = buffer_.size();
    buffer_.resize(old_size + std::max(kChunkBytes, std::min(wanted - old_size, old_size)));
    in_.read(reinterpret_cast<char*>(buffer_.data() + old_size),
             static_cast<std::streamsize>(buffer_.size() - old_size));
    buffer_.resize(old_size + static_cast<std::size_t>(in_.gcount()));
    if (in_.bad()) throw std::runtime_error("reading the log failed");
  }
  return std::min(wanted, buffer_.size());
}

std::uint64_t EventLogReader::big_endian(std::size_t offset, std::size_t size) const {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < size; ++i) value = value << 8 | buffer_[position_ + offset + i];
  return value;
}

// Whether a record may begin there: the magic number, as far as the file goes.
bool EventLogReader::magic_at(std::size_t offset) {
  const std::size_t end = available(offset + 4);
  for (std::size_t i = offset; i < end; ++i) {
    if (buffer_[position_ + i] != magic_byte(i - offset)) return false;
  }
  return true;
}

bool EventLogReader::looks_like_log() { return magic_at(0); }

EventLogReader::Verdict EventLogReader::judge() {
  if (!magic_at(0)) return Verdict::not_a_record;
  if (available(kHeaderBytes) < kHeaderBytes) return Verdict::breaks_off;
  const auto channel_bytes = static_cast<std::uint32_t>(big_endian(20, 4));
  const auto data_bytes = static_cast<std::uint32_t>(big_endian(24, 4));
  if (channel_bytes < 1 || channel_bytes > kMaxChannelBytes || data_bytes > kMaxDataBytes) {
    return Verdict::not_a_record;
  }
  record_bytes_ = kHeaderBytes + channel_bytes + data_bytes;
  if (available(record_bytes_) < record_bytes_) return Verdict::breaks_off;
  return magic_at(record_bytes_) ? Verdict::record : Verdict::not_a_record;
}

bool EventLogReader::next(LoggedEvent& event) {
  std::optional<std::uint64_t> damage_begin;
  bool breaks_off = false;  // beginning of the damage
  while (available(1) > 0) {
    const Verdict verdict = judge();
    if (verdict == Verdict::record) {
      if (damage_begin) end_damage(*damage_begin, false);
      event.event_number = static_cast<std::int64_t>(big_endian(4, 8));
      event.timestamp_us = static_cast<std::int64_t>(big_endian(12, 8));
      const auto channel_bytes = static_cast<std::size_t>(big_endian(20, 4));
      const std::uint8_t* const body = buffer_.data() + position_ + kHeaderBytes;
      event.channel.assign(reinterpret_cast<const char*>(body), channel_bytes);
      event.data = {body + channel_bytes, record_bytes_ - kHeaderBytes - channel_bytes};
      position_ += record_bytes_;
      return true;
    }
    if (!damage_begin) {
      damage_begin = offset_bytes();
      breaks_off = verdict == Verdict::breaks_off;
    }
    skip_to_possible_record();
  }
  if (damage_begin) end_damage(*damage_begin, breaks_off);
  return false;
}

// Moves at least one byte on, to the next first byte of a magic number or the end.
void EventLogReader::skip_to_possible_record() {
  ++position_;
  while (available(1) > 0) {
    const auto from = buffer_.begin() + static_cast<std::ptrdiff_t>(position_);
    const auto found = std::find(from, buffer_.end(), magic_byte(0));
    position_ = static_cast<std::size_t>(found - buffer_.begin());
    if (found != buffer_.end()) return;
  }
}

void EventLogReader::end_damage(std::uint64_t begin, bool truncated) {
  damage_.push_back({begin, offset_bytes() - begin, truncated});
}

}  // namespace tether
