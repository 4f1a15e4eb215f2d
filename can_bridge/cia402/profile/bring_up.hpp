#pragma once

#include <optional>
#include <string>
#include <vector>

#include "can_bridge/cia402/drives/drives.hpp"

namespace tether::cia402 {

/// The stages from start() to `standby`, or to `refused` with the reason why.
class BringUp {
 public:
  explicit BringUp(Drives& drives) : d_(drives) {}

  /// Starts from the beginning. Drives that are heard or answer are braked first.
  void begin();
  /// In the stages from `listening` to `settling`. NMT commands go to `nmt`, SDO requests to
  /// `service`.
  void tick(Instant now, std::vector<CanFrame>& nmt, std::vector<CanFrame>& service);
  /// Next event that the present stage waits for.
  std::string waiting_for(Instant now) const;

 private:
  void note_lost_nodes(Instant now);
  void listen(Instant now);
  /// A drive that may be in NMT "stopped" goes to pre-operational, so that it can be asked.
  void recall(Node& node, Instant now, std::vector<CanFrame>& nmt);
  /// Its silence is not that of NMT "stopped".
  bool has_been_recalled(const Node& node, Instant now) const;
  void secure(Instant now, std::vector<CanFrame>& nmt, std::vector<CanFrame>& service);
  /// The last look at the counters before the reset clears them.
  void take_up_positions(Instant now);
  bool may_be_reset(const Node& node, Instant now) const;
  /// By its watchdog or ramp, since it was last heard.
  bool can_have_stopped(const Node& node) const;
  std::string turning_text(Instant now) const;
  void begin_configuration(Instant now);
  void configure(Instant now, std::vector<CanFrame>& nmt, std::vector<CanFrame>& service);
  void start_up(Node& node, Instant now, std::vector<CanFrame>& nmt,
                std::vector<CanFrame>& service);
  void start_nodes(Instant now, std::vector<CanFrame>& nmt);
  void activate(Instant now, std::vector<CanFrame>& nmt);
  void settle(Instant now);
  std::string not_settled(Instant now) const;

  Drives& d_;
  bool begun_ = false;  // and not yet ticked
  std::optional<Instant> ticked_;
  Instant nmt_start_at_{};
};

}  // namespace tether::cia402
