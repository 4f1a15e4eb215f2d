#include "can_bridge/emulated/pdos.hpp"

#include <algorithm>

namespace tether {
namespace {

using canopen::Abort;

constexpr std::uint32_t kOff = 0x8000'0000;

/// Identifiers that are never a PDO's (CiA 301, table 28).
bool is_restricted(std::uint32_t id) {
  return id <= 0x07F || (id >= 0x101 && id <= 0x180) || (id >= 0x581 && id <= 0x5FF) ||
         (id >= 0x601 && id <= 0x67F) || (id >= 0x6E0 && id <= 0x6FF) || id >= 0x701;
}

bool is_event_driven(std::uint8_t transmission) { return transmission >= 254; }

}  // namespace

EmulatedPdos::EmulatedPdos(const ObjectDictionary& dictionary, RpdoReceiver& receiver)
    : dictionary_(dictionary), receiver_(receiver) {
  for (std::uint16_t i = 0; i < 4; ++i) {
    for (const bool transmit : {false, true}) {
      const auto base = static_cast<std::uint16_t>(0x1400 + (transmit ? 0x400 : 0) + i);
      const auto mapping = static_cast<std::uint16_t>(base + 0x200);
      Pdo& pdo = transmit ? tpdos_[i] : rpdos_[i];
      pdo.transmit = transmit;
      pdo.cob_id = dictionary.find(base, 1);
      pdo.type = dictionary.find(base, 2);
      pdo.inhibit = dictionary.find(base, 3);
      pdo.event_timer = dictionary.find(base, 5);
      pdo.count = dictionary.find(mapping, 0);
      for (std::uint8_t sub = 1; sub <= 8; ++sub) {
        pdo.map[sub - 1u] = dictionary.find(mapping, sub);
      }
    }
  }
  reload();
}

const EmulatedPdos::Pdo* EmulatedPdos::owner(Handle h) const {
  const std::uint16_t index = dictionary_.entry(h).ref.index;
  const std::uint16_t kind = index & 0xFFFC;
  if (kind == 0x1400 || kind == 0x1600) return &rpdos_[index & 3];
  if (kind == 0x1800 || kind == 0x1A00) return &tpdos_[index & 3];
  return nullptr;
}

std::optional<Abort> EmulatedPdos::refuses(Handle h, std::int64_t value) const {
  const Pdo* pdo = owner(h);
  if (pdo == nullptr) return std::nullopt;
  if (h == pdo->cob_id) return refuses_cob_id(*pdo, value);
  if (h == pdo->type && value > 240 && value < 254) return Abort::invalid_value;
  if (h == pdo->inhibit && pdo->valid) return Abort::device_state;
  if (h == pdo->count) return refuses_count(*pdo, value);
  if (std::find(pdo->map.begin(), pdo->map.end(), h) != pdo->map.end()) {
    return refuses_entry(*pdo, value);
  }
  return std::nullopt;
}

std::optional<Abort> EmulatedPdos::refuses_cob_id(const Pdo& pdo, std::int64_t value) const {
  const auto raw = static_cast<std::uint32_t>(value);
  const bool valid = (raw & kOff) == 0;
  const std::uint32_t id = raw & 0x7FF;
  constexpr std::uint32_t kExtended = 0x3FFF'F800;
  if ((raw & kExtended) != 0) return Abort::invalid_value;
  if (!valid) return std::nullopt;
  if (pdo.valid && id != pdo.id) return Abort::invalid_value;
  if (is_restricted(id) || pdo.objects == 0) return Abort::invalid_value;
  return std::nullopt;
}

std::optional<Abort> EmulatedPdos::refuses_entry(const Pdo& pdo, std::int64_t value) const {
  if (pdo.valid || dictionary_.value(pdo.count) != 0) return Abort::device_state;
  if (value == 0) return std::nullopt;
  if (mappable(value, pdo.transmit) == ObjectDictionary::kNone) return Abort::cannot_map;
  return std::nullopt;
}

std::optional<Abort> EmulatedPdos::refuses_count(const Pdo& pdo, std::int64_t value) const {
  if (pdo.valid) return Abort::device_state;
  if (value > static_cast<std::int64_t>(pdo.map.size())) return Abort::pdo_too_long;
  int bits = 0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(value); ++i) {
    const std::int64_t entry = dictionary_.value(pdo.map[i]);
    if (mappable(entry, pdo.transmit) == ObjectDictionary::kNone) return Abort::cannot_map;
    bits += static_cast<int>(entry & 0xFF);
  }
  if (bits > 64) return Abort::pdo_too_long;
  return std::nullopt;
}

ObjectDictionary::Handle EmulatedPdos::mappable(std::int64_t entry, bool transmit) const {
  const auto raw = static_cast<std::uint32_t>(entry);
  const Handle h = dictionary_.find(static_cast<std::uint16_t>(raw >> 16),
                                    static_cast<std::uint8_t>(raw >> 8 & 0xFF));
  if (h == ObjectDictionary::kNone) return h;
  const ObjectDictionary::Entry& e = dictionary_.entry(h);
  const bool allowed = e.mapping == ObjectDictionary::Mapping::both ||
                       (transmit && e.mapping == ObjectDictionary::Mapping::transmit);
  return allowed && (raw & 0xFF) == e.ref.bytes * 8u ? h : ObjectDictionary::kNone;
}

void EmulatedPdos::reload() {
  for (Pdo& pdo : rpdos_) load(pdo);
  for (Pdo& pdo : tpdos_) load(pdo);
}

void EmulatedPdos::load(Pdo& pdo) {
  const auto cob_id = static_cast<std::uint32_t>(dictionary_.value(pdo.cob_id));
  const bool valid = (cob_id & kOff) == 0;
  if (valid != pdo.valid) {
    pdo.waiting = pdo.transmit && valid;
    pdo.watched = false;
    pdo.syncs = 0;
  }
  pdo.valid = valid;
  pdo.id = cob_id & 0x7FF;
  pdo.transmission = static_cast<std::uint8_t>(dictionary_.value(pdo.type));
  pdo.event_time = std::chrono::milliseconds{dictionary_.value(pdo.event_timer)};
  if (pdo.inhibit != ObjectDictionary::kNone) {
    pdo.inhibit_time = std::chrono::microseconds{100 * dictionary_.value(pdo.inhibit)};
  }
  pdo.objects = 0;
  pdo.bytes = 0;
  const auto count = static_cast<std::size_t>(dictionary_.value(pdo.count));
  for (std::size_t i = 0; i < count; ++i) {
    const Handle h = mappable(dictionary_.value(pdo.map[i]), pdo.transmit);
    if (h == ObjectDictionary::kNone || pdo.bytes + dictionary_.entry(h).ref.bytes > 8) break;
    pdo.object[pdo.objects++] = h;
    pdo.bytes = static_cast<std::uint8_t>(pdo.bytes + dictionary_.entry(h).ref.bytes);
  }
}

void EmulatedPdos::start(Instant now) {
  for (Pdo& pdo : rpdos_) {
    pdo.waiting = false;
    pdo.watched = false;
  }
  for (Pdo& pdo : tpdos_) {
    pdo.waiting = true;
    pdo.syncs = 0;
    pdo.last = now - pdo.inhibit_time;
    sample(pdo, pdo.frame);
  }
}

EmulatedPdos::Received EmulatedPdos::on_frame(const CanFrame& frame, Instant now) {
  Received result = Received::not_mine;
  for (Pdo& pdo : rpdos_) {
    if (!pdo.valid || pdo.id != frame.id) continue;
    if (frame.size < pdo.bytes) {
      result = Received::too_short;
      continue;
    }
    if (result == Received::not_mine) result = Received::taken;
    pdo.last = now;
    pdo.watched = true;
    pdo.frame = frame;
    if (is_event_driven(pdo.transmission)) {
      deliver(pdo);
    } else {
      pdo.waiting = true;
    }
  }
  return result;
}

void EmulatedPdos::deliver(const Pdo& pdo) {
  const std::uint8_t* data = pdo.frame.data.data();
  for (std::uint8_t i = 0; i < pdo.objects; ++i) {
    const ObjectRef& ref = dictionary_.entry(pdo.object[i]).ref;
    receiver_.receive_object(pdo.object[i], canopen::read_integer(data, ref.bytes, ref.is_signed));
    data += ref.bytes;
  }
}

void EmulatedPdos::on_sync(Instant now, std::vector<CanFrame>& out) {
  for (Pdo& pdo : rpdos_) {
    if (!pdo.valid || !pdo.waiting || is_event_driven(pdo.transmission)) continue;
    pdo.waiting = false;
    deliver(pdo);
  }
  for (Pdo& pdo : tpdos_) {
    if (!pdo.valid || is_event_driven(pdo.transmission)) continue;
    if (pdo.transmission == 0) {
      if (pdo.waiting) send(pdo, now, out);
    } else if (++pdo.syncs >= pdo.transmission) {
      pdo.syncs = 0;
      send(pdo, now, out);
    }
  }
}

void EmulatedPdos::tick(Instant now, std::vector<CanFrame>& out) {
  for (Pdo& pdo : tpdos_) {
    if (!pdo.valid || (pdo.transmission >= 1 && pdo.transmission <= 240)) continue;
    if (!pdo.waiting) {
      CanFrame frame;
      sample(pdo, frame);
      pdo.waiting = changed(pdo, frame);
    }
    if (pdo.transmission == 0) continue;  // waits for SYNC
    const bool timer = pdo.event_time > Duration{0} && now - pdo.last >= pdo.event_time;
    if ((pdo.waiting || timer) && now - pdo.last >= pdo.inhibit_time) send(pdo, now, out);
  }
}

void EmulatedPdos::sample(const Pdo& pdo, CanFrame& frame) const {
  frame.id = pdo.id;
  frame.size = pdo.bytes;
  std::uint8_t* data = frame.data.data();
  for (std::uint8_t i = 0; i < pdo.objects; ++i) {
    const std::uint8_t bytes = dictionary_.entry(pdo.object[i]).ref.bytes;
    canopen::write_integer(data, bytes, dictionary_.value(pdo.object[i]));
    data += bytes;
  }
}

bool EmulatedPdos::changed(const Pdo& pdo, const CanFrame& now) const {
  std::size_t at = 0;
  for (std::uint8_t i = 0; i < pdo.objects; ++i) {
    const ObjectDictionary::Entry& entry = dictionary_.entry(pdo.object[i]);
    const std::size_t end = at + entry.ref.bytes;
    const bool counts = !entry.measured || pdo.inhibit_time > Duration{0};
    for (; at < end; ++at) {
      if (counts && now.data[at] != pdo.frame.data[at]) return true;
    }
  }
  return false;
}

void EmulatedPdos::send(Pdo& pdo, Instant now, std::vector<CanFrame>& out) {
  sample(pdo, pdo.frame);
  pdo.waiting = false;
  pdo.last = now;
  out.push_back(pdo.frame);
}

bool EmulatedPdos::deadline_missed(Instant now) {
  bool missed = false;
  for (Pdo& pdo : rpdos_) {
    if (!pdo.valid || !pdo.watched || pdo.event_time <= Duration{0}) continue;
    if (now - pdo.last < pdo.event_time) continue;
    pdo.watched = false;
    missed = true;
  }
  return missed;
}

}  // namespace tether
