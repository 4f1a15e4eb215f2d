#pragma once

#include <fstream>
#include <string>

#include "tools/messages/event_log.hpp"

namespace tether {

/// An open log file. Throws UsageError that names it if it cannot be read or is no LCM event log.
class LogInput {
 public:
  explicit LogInput(const std::string& path);

 private:
  std::ifstream stream_;

 public:
  EventLogReader reader;
};

/// One line, for people.
std::string describe(const LogDamage& damage);

}  // namespace tether
