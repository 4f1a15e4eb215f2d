#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "tools/doctor/latency.hpp"

namespace tether {

/// Present state of a machine, as far as it matters to Tether. Texts are the system's own words.
struct Machine {
  std::string version;  ///< version of this program, with its commit
  /// Programs of Tether beside this one that say another, and what they say.
  std::map<std::string, std::string> other_versions;
  std::string kernel;  ///< "6.1.0-18-amd64"
  bool realtime_kernel = false;

  std::string lcm_url;       ///< the URL in question
  std::string multicast_by;  ///< address by which datagrams to the group leave; empty: no route
  std::string multicast_trouble;    ///< why there is no route
  std::string multicast_interface;  ///< by which they leave; empty: not known
  bool multicast_by_radio = false;  ///< multicast goes by a radio
  std::string port_trouble;         ///< why the port cannot be listened to; empty: it can
  /// How long a message took to come back on the network; none: it did not within kPatience.
  std::optional<double> echo_ms;

  std::optional<std::int64_t> rmem_max_bytes;  ///< none: not told
  bool clock_synchronised = false;
  bool has_chrony = false;
  double clock_error_max_ms = 0.0;  ///< the kernel's estimate; it means nothing if not synchronised

  struct Can {
    bool is_can = false;  ///< not another kind of interface
    bool up = false;
  };
  std::map<std::string, Can> can;  ///< by name: those that there are, and the one asked about
  std::string can_asked;           ///< empty: none

  struct Peer {  ///< a peer of tether-link's LINK/REPORT
    bool up = false;
    bool clocks_apart = false;
    double offset_min_ms = 0.0, offset_max_ms = 0.0;
  };
  bool link_asked = false;
  std::map<std::string, Peer> peers;  ///< by name

  bool may_be_realtime = false;  ///< SCHED_FIFO is granted
  bool may_lock_memory = false;
  /// Governors of processors with frequency scaling; a name and how many have it.
  std::map<std::string, int> governors;

  /// Missing ones of the programs that parts of Tether start.
  std::vector<std::string> missing_programs;
};

/// Looks. Takes up to a third of a second if nothing comes back on the network, and with `link` as
/// long as a report of the link may take. Throws UsageError for an invalid LCM URL.
Machine examine(const std::string& lcm_url, const std::string& can_interface, bool link);

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
