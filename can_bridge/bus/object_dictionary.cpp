#include "can_bridge/bus/object_dictionary.hpp"

#include <algorithm>
#include <cassert>

namespace tether {
namespace {

std::uint32_t key_of(std::uint16_t index, std::uint8_t sub) {
  return static_cast<std::uint32_t>(index) << 8 | sub;
}

std::int64_t fit(std::int64_t value, std::uint8_t bytes, bool is_signed) {
  if (bytes == 0) return value;
  const int unused = 64 - 8 * bytes;
  const std::uint64_t shifted = static_cast<std::uint64_t>(value) << unused;
  if (is_signed) return static_cast<std::int64_t>(shifted) >> unused;
  return static_cast<std::int64_t>(shifted >> unused);
}

}  // namespace

ObjectDictionary::Handle ObjectDictionary::add(Entry entry) {
  assert(entry.ref.bytes <= 4 && entries_.size() < kNone);
  const std::uint32_t key = key_of(entry.ref.index, entry.ref.sub);
  const auto place = std::lower_bound(order_.begin(), order_.end(), std::pair{key, Handle{0}});
  assert(place == order_.end() || place->first != key);
  const auto handle = static_cast<Handle>(entries_.size());
  order_.insert(place, {key, handle});
  values_.push_back(fit(entry.initial, entry.ref.bytes, entry.ref.is_signed));
  entries_.push_back(std::move(entry));
  return handle;
}

void ObjectDictionary::close_records() {
  std::vector<Entry> missing;
  for (auto it = order_.begin(); it != order_.end();) {
    const std::uint32_t index = it->first >> 8;
    const bool has_sub0 = (it->first & 0xFF) == 0;
    std::uint32_t highest = 0;
    for (; it != order_.end() && it->first >> 8 == index; ++it) highest = it->first & 0xFF;
    if (has_sub0) continue;
    Entry count;
    count.ref = {static_cast<std::uint16_t>(index), 0, 1, false};
    count.access = Access::read_only;
    count.initial = highest;
    missing.push_back(count);
  }
  for (Entry& entry : missing) add(std::move(entry));
}

ObjectDictionary::Handle ObjectDictionary::find(std::uint16_t index, std::uint8_t sub) const {
  const std::uint32_t key = key_of(index, sub);
  const auto place = std::lower_bound(order_.begin(), order_.end(), std::pair{key, Handle{0}});
  return place != order_.end() && place->first == key ? place->second : kNone;
}

bool ObjectDictionary::has_index(std::uint16_t index) const {
  const auto place =
      std::lower_bound(order_.begin(), order_.end(), std::pair{key_of(index, 0), Handle{0}});
  return place != order_.end() && place->first >> 8 == index;
}

std::int64_t ObjectDictionary::value(Handle h) const {
  const Entry& e = entries_[h];
  if (e.low_half == kNone) return values_[h];
  const std::int64_t low = value(e.low_half) & 0xFFFF;
  const std::int64_t high = e.high_half == kNone ? 0 : value(e.high_half) & 0xFFFF;
  return fit(high << 16 | low, e.ref.bytes, e.ref.is_signed);
}

void ObjectDictionary::store(Handle h, std::int64_t value) {
  const Entry& e = entries_[h];
  if (e.low_half == kNone) {
    values_[h] = fit(value, e.ref.bytes, e.ref.is_signed);
    return;
  }
  const auto half = [this](Handle part, std::int64_t raw) {
    store(part, fit(raw, 2, entries_[part].ref.is_signed));
  };
  half(e.low_half, value);
  if (e.high_half != kNone) half(e.high_half, value >> 16);
}

void ObjectDictionary::restore(std::uint16_t first, std::uint16_t last) {
  for (std::size_t h = 0; h < entries_.size(); ++h) {
    const Entry& e = entries_[h];
    if (e.ref.index < first || e.ref.index > last) continue;
    values_[h] = fit(e.initial, e.ref.bytes, e.ref.is_signed);
  }
}

}  // namespace tether
