#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "can_bridge/bus/object_ref.hpp"

namespace tether {

/// A CANopen device's object dictionary (CiA 301, 7.4): values by index and subindex, with access
/// rights and value ranges. Built once; from then on values are reached by handle, without search.
class ObjectDictionary {
 public:
  using Handle = std::uint16_t;
  static constexpr Handle kNone = 0xFFFF;

  enum class Access : std::uint8_t { read_only, read_write };
  /// Whether the object may travel in PDOs.
  enum class Mapping : std::uint8_t {
    none,
    transmit,  ///< in TPDOs
    both,      ///< in TPDOs and RPDOs
  };

  struct Entry {
    ObjectRef ref;
    Access access = Access::read_write;
    Mapping mapping = Mapping::none;
    /// A measured value, which changes all the time: its change alone sends no event-driven TPDO.
    bool measured = false;
    std::int64_t initial = 0;  ///< after power-on
    std::int64_t minimum = INT64_MIN;
    std::int64_t maximum = INT64_MAX;
    /// A packed object has no value of its own: its 16-bit halves are two other objects.
    Handle low_half = kNone;
    Handle high_half = kNone;
    /// Strings (read-only) have their text here, and ref.bytes = 0.
    std::string text{};
  };

  /// `entry.ref` must be new. The value is `entry.initial`.
  Handle add(Entry entry);

  /// Adds the subindex 0 (highest subindex, read-only) to every object that has only others.
  void close_records();

  /// kNone if there is no such object.
  Handle find(std::uint16_t index, std::uint8_t sub) const;
  bool has_index(std::uint16_t index) const;

  const Entry& entry(Handle h) const { return entries_[h]; }
  /// For building: ranges and initial values may be refined, `ref` may not.
  Entry& edit(Handle h) { return entries_[h]; }

  /// The value, within the entry's size and sign.
  std::int64_t value(Handle h) const;
  /// Keeps what fits into the entry's size, as a register does. Checks nothing else.
  void store(Handle h, std::int64_t value);

  /// Gives all objects with first <= index <= last their initial values.
  void restore(std::uint16_t first, std::uint16_t last);

 private:
  std::vector<Entry> entries_;
  std::vector<std::int64_t> values_;
  std::vector<std::pair<std::uint32_t, Handle>> order_;  // sorted by index and subindex
};

}  // namespace tether
