#pragma once

#include <any>
#include <vector>

namespace tether {

/// Settings of things that are chosen by name, such as control laws. Each choice has a struct of
/// its own, which only its own files know. A struct has its defaults until it is written.
class OwnSettings {
 public:
  template <class Settings>
  const Settings& get() const {
    static const Settings kDefaults;
    for (const Entry& entry : entries_) {
      if (const auto* found = std::any_cast<Settings>(&entry.settings)) return *found;
    }
    return kDefaults;
  }

  template <class Settings>
  Settings& get() {
    for (Entry& entry : entries_) {
      if (auto* found = std::any_cast<Settings>(&entry.settings)) return *found;
    }
    entries_.push_back({Settings{}, [](const OwnSettings& a, const OwnSettings& b) {
                          return a.get<Settings>() == b.get<Settings>();
                        }});
    return *std::any_cast<Settings>(&entries_.back().settings);
  }

  /// A struct that was never written to equals one at its defaults.
  bool operator==(const OwnSettings& other) const { return equals(other) && other.equals(*this); }

 private:
  struct Entry {
    std::any settings;
    bool (*same)(const OwnSettings&, const OwnSettings&);
  };

  bool equals(const OwnSettings& other) const {
    for (const Entry& entry : entries_) {
      if (!entry.same(*this, other)) return false;
    }
    return true;
  }

  std::vector<Entry> entries_;
};

}  // namespace tether
