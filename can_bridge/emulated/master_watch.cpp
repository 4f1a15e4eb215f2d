#include "can_bridge/emulated/master_watch.hpp"

#include <utility>

namespace tether {
namespace {

using canopen::Abort;

constexpr std::int64_t producer_of(std::int64_t setting) { return setting >> 16; }
constexpr std::int64_t milliseconds_of(std::int64_t setting) { return setting & 0xFFFF; }
constexpr bool is_off(std::int64_t setting) {
  return producer_of(setting) == 0 || milliseconds_of(setting) == 0;
}

}  // namespace

EmulatedMasterWatch::EmulatedMasterWatch(const ObjectDictionary& dictionary,
                                         const std::vector<Handle>& consumers,
                                         std::vector<Handle> watchdogs)
    : dictionary_(dictionary), watchdogs_(std::move(watchdogs)) {
  for (const Handle h : consumers) consumers_.push_back({.object = h});
}

void EmulatedMasterWatch::reset() {
  for (Consumer& consumer : consumers_) consumer.active = false;
  contact_ = false;
}

std::optional<Abort> EmulatedMasterWatch::refuses(Handle h, std::int64_t value) const {
  constexpr std::uint32_t kParameterIncompatibility = 0x0604'0043;
  bool mine = false;
  bool clash = false;
  for (const Consumer& consumer : consumers_) {
    if (consumer.object == h) {
      mine = true;
      continue;
    }
    const std::int64_t other = dictionary_.value(consumer.object);
    clash = clash || (!is_off(other) && producer_of(other) == producer_of(value));
  }
  if (!mine) return std::nullopt;
  constexpr std::int64_t kHighestNode = 127;
  if (producer_of(value) > kHighestNode) return Abort::invalid_value;
  if (!is_off(value) && clash) return static_cast<Abort>(kParameterIncompatibility);
  return std::nullopt;
}

void EmulatedMasterWatch::written(Handle h) {
  for (Consumer& consumer : consumers_) {
    if (consumer.object == h) consumer.active = false;
  }
}

bool EmulatedMasterWatch::on_heartbeat(const CanFrame& frame, Instant now) {
  constexpr auto kBootUp = static_cast<std::uint8_t>(canopen::NmtState::boot_up);
  if (frame.size != 1 || frame.data[0] == kBootUp) return false;
  for (Consumer& consumer : consumers_) {
    const std::int64_t setting = dictionary_.value(consumer.object);
    if (is_off(setting)) continue;
    if (frame.id != canopen::kHeartbeat + static_cast<std::uint32_t>(producer_of(setting)))
      continue;
    consumer.active = true;
    consumer.last = now;
    return true;
  }
  return false;
}

bool EmulatedMasterWatch::heartbeat_missed(Instant now) {
  bool missed = false;
  for (Consumer& consumer : consumers_) {
    if (!consumer.active) continue;
    const std::int64_t limit_ms = milliseconds_of(dictionary_.value(consumer.object));
    if (now - consumer.last < std::chrono::milliseconds{limit_ms}) continue;
    consumer.active = false;
    missed = true;
  }
  return missed;
}

void EmulatedMasterWatch::contact(Instant now) {
  contact_ = true;
  last_contact_ = now;
}

bool EmulatedMasterWatch::watchdog_missed(Instant now) {
  if (!contact_) return false;
  for (const Handle h : watchdogs_) {
    const Duration limit = std::chrono::milliseconds{dictionary_.value(h)};
    if (limit <= Duration{0} || now - last_contact_ < limit) continue;
    contact_ = false;
    return true;
  }
  return false;
}

}  // namespace tether
