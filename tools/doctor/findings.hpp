#pragma once

#include <string>
#include <vector>

#include "tools/doctor/latency.hpp"
#include "tools/doctor/machine.hpp"

namespace tether {

/// One thing that was looked at.
struct DoctorFinding {
  enum class Verdict {
    good,
    note,   ///< works, but not as well as it could, or not all
    wrong,  ///< something will not work
  };
  Verdict verdict;
  std::string about;  ///< one word
  std::string what;   ///< present state
  std::string to_do;  ///< a command, or words; empty if good
};

/// Findings on a machine, always in the same order. Pure.
std::vector<DoctorFinding> findings_of(const Machine& machine);

/// Whether a machine of that latency keeps control cycles of `cycle_ms`. Pure.
DoctorFinding finding_of(const Latency& latency, double cycle_ms);

/// A line each: "wrong  multicast  no route …; sudo ip route add …".
std::string text_of(const std::vector<DoctorFinding>& findings);

/// Whether any is wrong.
bool is_anything_wrong(const std::vector<DoctorFinding>& findings);

}  // namespace tether
