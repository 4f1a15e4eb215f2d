#pragma once

#include "common/base/time.hpp"
#include "netem/medium/frame_queue.hpp"

namespace tether {

/// How long frames are in the air: IEEE 802.11-2016, 17.4.3 (OFDM) and 802.11ax-2021, 27.4.3 (HE).
struct WifiPhy {
  enum class Format {
    ofdm,  ///< 20 µs, then symbols of 4 µs
    he_su  ///< 36 µs and 8 µs a long training field, then symbols of 13.6 µs (guard 0.8 µs)
  };
  Format format = Format::ofdm;
  /// Rate of a data frame's payload bits: 6 … 54 with OFDM; with HE bits a symbol / 13.6 µs, 86.0
  /// for MCS 7 at 20 MHz with one stream.
  double data_rate_Mbps = 54.0;
  double control_rate_Mbps = 24.0;  ///< rate of acknowledgements, which are always OFDM
  Duration sifs = std::chrono::microseconds{16};
};

inline constexpr int kAckBytes = 14;
/// Overhead of an IP packet in a frame: LLC and SNAP, header of QoS data, FCS.
inline constexpr int kWifiOverheadBytes = 8 + 26 + 4;

/// Airtime of a PPDU with `bytes` of MAC frame (PSDU), service and tail bits added.
Duration ofdm_airtime(int bytes, double rate_Mbps);
Duration he_su_airtime(int bytes, double rate_Mbps);
Duration data_airtime(const WifiPhy& phy, int bytes);

/// A unicast frame of `bytes` with MAC header and FCS: data, SIFS, ACK. Who cannot read it waits as
/// long, too, before the medium is idle for it: EIFS, 10.3.2.3.7, or an ACK time-out (`eifs`); or
/// for nothing but the frame itself.
Frame unicast_frame(const WifiPhy& phy, int bytes, bool eifs);
/// One without an acknowledgement.
Frame broadcast_frame(const WifiPhy& phy, int bytes);

}  // namespace tether
