#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/base/say.hpp"
#include "common/base/time.hpp"
#include "link/session/refusals.hpp"

namespace tether::link {

/// Status of a peer in lines for the log: whether it is connected, by which paths, or the probable
/// reason why not and the remedy. The lines contain no byte from an unauthenticated sender.
class Diagnosis {
 public:
  /// Time before a missing peer is reported. A lost peer is reported at once.
  static constexpr Duration kPatience = std::chrono::seconds{5};

  explicit Diagnosis(std::string peer) : peer_(std::move(peer)) {}

  struct Sight {
    std::vector<std::string> alive;  ///< names of the paths
    std::vector<std::string> dead;
    std::vector<std::string> narrow;  ///< alive, but nothing as long as the mtu comes through
    std::size_t mtu = 0;
    bool crossed = false;  ///< its PROBEs come by the other path
    Refusals refused;
    double clock_ahead_s = 0.0;   ///< lead in the newest HELLO that was refused for it
    double clock_offset_s = 0.0;  ///< lower bound, as the session has measured it
    double clock_warning_s = 0.05;
    double clock_limit_s = 0.2;  ///< from there on, messages for a time are refused
  };
  struct Line {
    Severity severity;
    std::string text;
  };
  /// Now; called several times a second. nullopt: nothing new.
  std::optional<Line> look(Instant now, const Sight& sight);

 private:
  std::string how_up(const Sight& sight);
  std::string why_down(const Sight& sight);
  std::string clocks_apart(double ahead_s);
  std::string clocks_differ(const Sight& sight);

  std::string peer_;
  std::optional<Instant> since_;  // looked at without seeing it
  Refusals then_;                 // when that began
  double ahead_said_s_ = 0.0;
  double differ_said_s_ = 0.0;  // 0: they do not
  bool was_up_ = false;
  std::string said_;
};

}  // namespace tether::link
