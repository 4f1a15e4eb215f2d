#pragma once

#include <vector>

#include "can_bridge/bus/can_port.hpp"
#include "common/base/random.hpp"
#include "common/node/event_loop.hpp"
#include "tests/campaign/trial.hpp"

namespace tether::campaign {

/// An unknown sender on the CAN bus that commands the drives or speaks in their name.
///
/// Writes by SDO are to objects that move a drive (controlword, target velocity, mode) or silence
/// it (heartbeat time), never to those that weaken its brakes or its watchdogs: no bridge can stop
/// a vehicle without brakes.
class UnknownSender {
 public:
  /// `commanded`: when it sent what may move or hold a drive.
  UnknownSender(const Trial& trial, EventLoop& loop, CanPort& port,
                std::vector<Instant>& commanded);

  void begin(const Fault& fault);

 private:
  void command(const CanFrame& frame);
  void send_nmt(const Fault& fault);
  void send_emcy(const Fault& fault);
  void write_objects(const Fault& fault);
  void be_master(const Fault& fault);
  void send_setpoint(const Fault& fault, int step);

  EventLoop& loop_;
  CanPort& port_;
  std::vector<Instant>& commanded_;
  RandomEngine random_;
};

}  // namespace tether::campaign
