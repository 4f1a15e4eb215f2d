#pragma once

#include <functional>
#include <string>
#include <vector>

#include "can_bridge/bus/can_frame.hpp"
#include "common/base/counters.hpp"

namespace tether {

/// State of the bus at a port. Everything but `up` and `error_passive` means that frames do
/// not get through.
enum class CanState {
  up,
  error_passive,  ///< the controller has counted many errors: wiring, termination, bit rate
  stalled,        ///< the interface takes no more frames, or no node acknowledges them
  bus_off,        ///< the controller has switched itself off the bus
  down,           ///< the interface exists and is not up
  absent,         ///< there is no such interface (unplugged, deleted)
};

/// For people and messages: "up", "error-passive", "stalled", "bus-off", "down", "absent".
const char* to_string(CanState state);

/// One participant's access to a CAN bus. Two implementations: SocketCanPort (the kernel's
/// SocketCAN, real time) and InProcessCan::Port (virtual time).
///
/// Nothing is ever queued for later: a frame that cannot be handed over at once is dropped and
/// counted, because an old setpoint is worse than none.
class CanPort {
 public:
  using FrameHandler = std::function<void(const CanFrame&)>;
  using StateHandler = std::function<void(CanState)>;

  virtual ~CanPort() = default;

  /// False if the frame was dropped: the bus is not able to take it now.
  virtual bool send(const CanFrame& frame) = 0;

  /// Frames of others that pass one of the filters; own frames never come back. The handler may
  /// send. Set once, before the loop runs.
  virtual void on_frame(std::vector<CanFilter> filters, FrameHandler handler) = 0;

  /// Called at each change of state.
  virtual void on_state(StateHandler handler) = 0;
  virtual CanState state() const = 0;

  /// Empties the queues of kernel and hardware, where that is possible, by taking the interface
  /// down and up again; for a bus that was off or stalled. Returns whether it was done; if not,
  /// `why` says what an operator has to do.
  virtual bool restart(std::string& why) = 0;

  /// A warning for the start of a program: what will not work in trouble, because restart() is not
  /// permitted. "" if there is nothing to warn of.
  virtual std::string warning() const { return ""; }

  /// Appends "can.sent", "can.received", "can.send_dropped", "can.rx_overflow"…
  virtual void list(CounterList& out) const = 0;

 protected:
  CanPort() = default;
  CanPort(const CanPort&) = delete;
  CanPort& operator=(const CanPort&) = delete;
};

}  // namespace tether
