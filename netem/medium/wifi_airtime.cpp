#include "netem/medium/wifi_airtime.hpp"

#include <cmath>

namespace tether {
namespace {

constexpr int kServiceAndTailBits = 22;

Duration symbols(int bytes, double rate_Mbps, Duration symbol) {
  const double bits_a_symbol = rate_Mbps * to_seconds(symbol) * 1e6;
  // An exact multiple must not be rounded up to one more.
  constexpr double kRounding = 1e-9;
  const double count = std::ceil((kServiceAndTailBits + 8 * bytes) / bits_a_symbol - kRounding);
  return static_cast<std::int64_t>(count) * symbol;
}

}  // namespace

Duration ofdm_airtime(int bytes, double rate_Mbps) {
  return std::chrono::microseconds{20} + symbols(bytes, rate_Mbps, std::chrono::microseconds{4});
}

Duration he_su_airtime(int bytes, double rate_Mbps) {
  return std::chrono::microseconds{44} + symbols(bytes, rate_Mbps, std::chrono::nanoseconds{13600});
}

Duration data_airtime(const WifiPhy& phy, int bytes) {
  return phy.format == WifiPhy::Format::ofdm ? ofdm_airtime(bytes, phy.data_rate_Mbps)
                                             : he_su_airtime(bytes, phy.data_rate_Mbps);
}

Frame unicast_frame(const WifiPhy& phy, int bytes, bool eifs) {
  Frame frame;
  frame.air = data_airtime(phy, bytes);
  frame.exchange = frame.air + phy.sifs + ofdm_airtime(kAckBytes, phy.control_rate_Mbps);
  frame.wasted = eifs ? frame.exchange : frame.air;
  return frame;
}

Frame broadcast_frame(const WifiPhy& phy, int bytes) {
  Frame frame;
  frame.air = frame.exchange = frame.wasted = data_airtime(phy, bytes);
  frame.acknowledged = false;
  return frame;
}

}  // namespace tether
