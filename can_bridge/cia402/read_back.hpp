#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "can_bridge/bus/sdo_client.hpp"
#include "can_bridge/cia402/startup.hpp"

namespace tether::cia402 {

/// The bits of `value` as they stand in an object of this size.
std::uint32_t raw(const ObjectRef& object, std::int64_t value);

/// Whether `value`, read from step.read_back, is step.expected in the bits of step.mask.
bool is_as_expected(const SdoStep& step, std::int64_t value);

/// "0x6085:0 (quick stop deceleration) reads 1 instead of 19200".
std::string deviation_text(const SdoStep& step, std::int64_t value);

/// Reads objects of one node again, one after the other, and says which is not as expected. Only
/// reads. No I/O and no clock.
class ReadBack {
 public:
  ReadBack(const Cia402Config& config, std::uint8_t node);

  /// From the beginning, at the next tick: read_back of each step.
  void begin(const std::vector<SdoStep>& steps);
  /// A frame with the identifier 0x580 + node. False: not the reply that is waited for.
  bool on_sdo(const CanFrame& frame) { return sdo_.on_frame(frame); }
  /// Asks for one object at most. Nothing any more once one deviates.
  void tick(Instant now, std::vector<CanFrame>& out);

  /// All were read and are as expected.
  bool done() const { return deviation_.empty() && next_ == steps_.size(); }
  /// The deviation: another value, an abort, or no answer; "" if nothing is known to be.
  const std::string& deviation() const { return deviation_; }

 private:
  void take_result();

  SdoClient sdo_;
  std::vector<SdoStep> steps_;
  std::size_t next_ = 0;
  std::string deviation_;
};

}  // namespace tether::cia402
