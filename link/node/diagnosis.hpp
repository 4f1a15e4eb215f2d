#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/base/time.hpp"
#include "link/session/refusals.hpp"

namespace tether::link {

/// What is to be said of a peer now and then, in lines without a byte of what strangers send: that
/// it is there, by which paths, or why perhaps not and what to do.
class Diagnosis {
 public:
  static constexpr Duration kPatience = std::chrono::seconds{5};  // before it says that nobody came

  explicit Diagnosis(std::string peer) : peer_(std::move(peer)) {}

  struct Sight {
    std::vector<std::string> alive;  ///< names of the paths
    std::vector<std::string> dead;
    Refusals refused;
    double clock_ahead_s = 0.0;
  };
  /// Now; called once a second or so. nullopt: nothing new.
  std::optional<std::string> look(Instant now, const Sight& sight);

 private:
  std::string why_down(const Sight& sight) const;

  std::string peer_;
  std::optional<Instant> since_;  // looked at without seeing it
  Refusals then_;                 // when that began
  std::string said_;
};

}  // namespace tether::link
