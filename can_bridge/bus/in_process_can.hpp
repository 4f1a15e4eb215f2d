#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "can_bridge/bus/can_port.hpp"
#include "common/node/event_loop.hpp"

namespace tether {

/// A CAN bus in virtual time, with the two properties that timing depends on: a frame takes as long
/// as its bits, and of the frames that wait, the lowest identifier goes first.
///
/// A data frame of n bytes counts as 55 + 10·n bits: its fields and the worst case of stuff bits
/// (Davis, Burns, Bril, Lukkien, "Controller Area Network (CAN) schedulability analysis: Refuted,
/// revisited and revised", Real-Time Systems 35, 2007, equation 3: 11-bit identifiers); with 29
/// bits, 80 + 10·n (equation 4). Every frame reaches all other ports at the end of its last bit.
class InProcessCan {
 public:
  /// Length of the queue at one port; further frames are dropped, as with a short txqueuelen.
  static constexpr std::size_t kQueueFrames = 10;

  class Port final : public CanPort {
   public:
    bool send(const CanFrame& frame) override;
    void on_frame(std::vector<CanFilter> filters, FrameHandler handler) override;
    void on_state(StateHandler handler) override { state_handler_ = std::move(handler); }
    CanState state() const override { return state_; }
    bool restart(std::string& why) override;
    void list(CounterList& out) const override;

    /// For tests: what happens to this port's access to the bus. Bus-off, stalled, down and absent
    /// neither send nor receive; down and absent drop what waits, stalled keeps it.
    void set_state(CanState state);

   private:
    friend class InProcessCan;
    explicit Port(InProcessCan& bus) : bus_(bus) {}
    bool connected() const { return state_ == CanState::up || state_ == CanState::error_passive; }
    void receive(const CanFrame& frame);

    InProcessCan& bus_;
    std::vector<CanFilter> filters_;
    FrameHandler frame_handler_;
    StateHandler state_handler_;
    CanState state_ = CanState::up;
    std::deque<CanFrame> waiting_;
    std::int64_t sent_ = 0;
    std::int64_t received_ = 0;
    std::int64_t send_dropped_ = 0;
    std::int64_t state_changes_ = 0;
  };

  /// `loop` must outlive the bus.
  InProcessCan(EventLoop& loop, double bit_rate_bps);

  /// A new participant; lives as long as the bus.
  Port& add_port();

  /// Every frame, at the end of its transmission: for tests and logs.
  void on_any_frame(CanPort::FrameHandler handler) { tap_ = std::move(handler); }

  /// Time on the bus of a frame with `size` data bytes.
  Duration frame_time(std::uint8_t size, bool extended = false) const;

  /// Share of the time since `since` that the bus was busy, 0…1.
  double load(Instant since) const;

 private:
  void start_next();
  void finish(const CanFrame& frame, const Port* sender);

  EventLoop& loop_;
  double bit_rate_bps_;
  std::vector<std::unique_ptr<Port>> ports_;
  CanPort::FrameHandler tap_;
  bool busy_ = false;
  Duration busy_time_{0};
};

}  // namespace tether
