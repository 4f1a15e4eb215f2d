#pragma once

#include <array>

namespace tether {

/// The rates of OFDM at 20 MHz, 802.11-2016, table 17-4: BPSK 1/2 and 3/4, QPSK 1/2 and 3/4, 16-QAM
/// 1/2 and 3/4, 64-QAM 2/3 and 3/4.
inline constexpr std::array<double, 8> kOfdmRates_Mbps{6, 9, 12, 18, 24, 36, 48, 54};

/// Share of frames of `bits`, with service and tail, that have an error at this ratio of signal to
/// noise on each subcarrier: white noise, a receiver that decodes hard decisions and loses nothing
/// else. `rate_Mbps`: one of kOfdmRates_Mbps.
///
/// 1 − (1 − Pe)^bits, where Pe ≤ Σ c_d D^d / 2k is the union bound of the convolutional code of
/// constraint length 7 (133, 171) and rate k/n with D² = 4 p (1 − p); c_d is the weight of its
/// errors with d coded bits (P. Frenger et al., "Multi-rate Convolutional Codes", 1998), and p a
/// coded bit's error: ½ erfc √s with BPSK, ½ erfc √(s/2) with QPSK, ⅜ erfc √(s/10) with 16-QAM,
/// 7/24 erfc √(s/42) with 64-QAM. L. E. Miller, "Validation of 802.11a/UWB Coexistence Simulation",
/// NIST, 2003; G. Pei and T. Henderson, "Validation of OFDM error rate model in ns-3", 2010.
double frame_error_ratio(double rate_Mbps, int bits, double snr_db);

/// With service and tail bits, of a MAC frame.
constexpr int frame_bits(int bytes) { return 22 + 8 * bytes; }

/// The highest rate up to `highest_Mbps` that loses at most `error_ratio` of frames with so many
/// bytes; 6 Mbit/s if none does.
double best_rate_mbps(double highest_Mbps, int bytes, double snr_db, double error_ratio);

}  // namespace tether
