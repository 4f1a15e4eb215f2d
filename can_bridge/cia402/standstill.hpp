#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "can_bridge/canopen/canopen.hpp"
#include "can_bridge/canopen/sdo_client.hpp"
#include "can_bridge/cia402/config.hpp"

namespace tether::cia402 {

/// Asks one node by SDO, again and again, whether its wheels stand. That works in NMT
/// pre-operational, too, where a drive that has lost its master's heartbeat brakes without telling
/// anything by PDO. Only reads. No I/O and no clock.
///
/// Read of each axis: statusword and actual velocity. Wheels stand when all of them are slower than
/// standstill_radps; with a power stage that is on, for half a second, because they might be
/// starting. Objects whose reading the node aborts are left out of the judgement.
class StandstillInquiry {
 public:
  enum class Verdict {
    unknown,   ///< no answer yet
    silent,    ///< none in all tries; it is asked on
    turning,   ///< as the newest answers say
    standing,  ///< as the newest answers say
  };
  struct Wheel {
    std::size_t axis = 0;  ///< 0 left, 1 right
    double speed_radps = 0.0;
  };

  StandstillInquiry(const Cia402Config& config, std::uint8_t node);

  /// From the beginning.
  void begin();
  /// A frame with the identifier 0x580 + node. False: not the reply that is waited for.
  bool on_sdo(const CanFrame& frame) { return sdo_.on_frame(frame); }
  void tick(Instant now, std::vector<CanFrame>& out);

  Verdict verdict() const { return verdict_; }
  /// The fastest wheel of the newest answers.
  const std::optional<Wheel>& fastest() const { return fastest_; }

 private:
  struct Reading {
    std::size_t axis = 0;
    std::optional<double> speed_radps;
    bool power_off = true;
  };

  void ask();
  void on_result(const SdoResult& result, Instant now);
  void judge(Instant now);

  Cia402Config config_;
  SdoClient sdo_;
  std::vector<Reading> readings_;  // of this round
  std::size_t question_ = 0;       // number of the next; each axis has two: statusword, velocity
  Verdict verdict_ = Verdict::unknown;
  std::optional<Wheel> fastest_;
  std::optional<Instant> standing_since_;
};

}  // namespace tether::cia402
