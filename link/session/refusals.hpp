#pragma once

#include <cstdint>

#include "common/base/counters.hpp"

namespace tether::link {

/// Datagrams that were not taken, by reason. Nothing else of them is kept or said anywhere.
struct Refusals {
  std::int64_t malformed = 0;    ///< no datagram of this protocol
  std::int64_t version = 0;      ///< another version of this protocol
  std::int64_t unknown_key = 0;  ///< a HELLO of a key that the configuration does not name
  std::int64_t address = 0;      ///< not from where this peer is
  std::int64_t no_session = 0;   ///< names a session that does not exist (any more)
  std::int64_t forged = 0;       ///< does not authenticate: forged, changed, reflected
  std::int64_t replayed = 0;     ///< came before, by the same path
  std::int64_t late = 0;         ///< authentic, but behind the replay window
  std::int64_t clock = 0;        ///< an authentic HELLO of a time too far from ours, or an old one
  std::int64_t crossed = 0;      ///< an authentic PROBE of another path: paths are not in one order

  std::int64_t sum() const {
    return malformed + version + unknown_key + address + no_session + forged + replayed + late +
           clock + crossed;
  }
  void list(CounterList& out) const {
    out.insert(out.end(), {{"malformed", malformed},
                           {"version", version},
                           {"stranger", unknown_key},
                           {"address", address},
                           {"no_session", no_session},
                           {"forged", forged},
                           {"replayed", replayed},
                           {"late", late},
                           {"clock", clock},
                           {"crossed", crossed}});
  }
};

}  // namespace tether::link
