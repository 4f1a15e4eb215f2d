#pragma once

#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "can_bridge/emulated/node.hpp"
#include "common/base/time.hpp"

namespace tether::test {

/// Two single-axis drives, nodes 1 (left) and 2 (right, mounted the other way round), in rpm: as a
/// drivetrain file would describe them.
inline Cia402Config two_node_drivetrain() {
  Cia402Config c;
  for (std::uint8_t node : {1, 2}) {
    c.axes[node - 1u].node = node;
    c.axes[node - 1u].sign = node == 1 ? 1 : -1;
    c.watchdogs.push_back({.node = node});
    const auto setup = [&](ObjectRef object, std::int64_t value) {
      c.setup.push_back({.node = node, .object = object, .value = value, .meaning = ""});
    };
    setup({0x1029, 1, 1, false}, 0);
    setup({0x6007, 0, 2, true}, 3);
    setup({0x605A, 0, 2, true}, 2);
    setup({0x6083, 0, 4, false}, 600);
    setup({0x6084, 0, 4, false}, 600);
    setup({0x6085, 0, 4, false}, 1200);
    c.pdos.push_back({.node = node,
                      .number = 1,
                      .transmission = 1,
                      .event_timer_ms = 100,
                      .objects = {{0x6040, 0, 2, false}, {0x60FF, 0, 4, true}}});
    c.pdos.push_back({.node = node,
                      .number = 1,
                      .transmit = true,
                      .transmission = 1,
                      .objects = {{0x6041, 0, 2, false}, {0x606C, 0, 4, true}}});
  }
  return c;
}

/// Emulated drives under a fake clock, with wheels that follow their targets at once (or not at
/// all), and a master's hands on the bus.
class DriveRig {
 public:
  struct Sent {
    Instant when;
    CanFrame frame;
  };

  explicit DriveRig(const Cia402Config& config, Instant start = kStart)
      : now_(start), drives_(config, start) {
    drives_.set_wheels({});
  }

  EmulatedCia402& drives() { return drives_; }
  EmulatedNode& node(std::size_t i = 0) { return *drives_.nodes()[i]; }
  Instant now() const { return now_; }
  /// All that the drives sent.
  const std::vector<Sent>& sent() const { return sent_; }
  void forget_sent() { sent_.clear(); }

  bool wheels_follow = true;

  /// Lets `milliseconds` pass, a tick each.
  void run(int milliseconds) {
    for (int i = 0; i < milliseconds; ++i) {
      now_ += std::chrono::milliseconds{1};
      if (wheels_follow) turn();
      take([&](std::vector<CanFrame>& out) { drives_.tick(now_, out); });
    }
  }

  void send(const CanFrame& frame) {
    take([&](std::vector<CanFrame>& out) { drives_.on_frame(frame, now_, out); });
  }
  void send(std::uint32_t id, std::initializer_list<std::uint8_t> bytes) {
    send(CanFrame::make(id, bytes));
  }
  void nmt(std::uint8_t command, std::uint8_t node = 0) { send(0x000, {command, node}); }
  void sync() { send(0x080, {}); }
  void heartbeat() { send(0x77F, {0x05}); }

  /// Frames with `id`, in order.
  std::vector<Sent> sent(std::uint32_t id) const {
    std::vector<Sent> found;
    for (const Sent& s : sent_) {
      if (s.frame.id == id) found.push_back(s);
    }
    return found;
  }

  /// Writes by expedited SDO. 0 if the drive took it, else the abort code; −1 without an answer.
  std::int64_t write(std::uint8_t node, std::uint16_t index, std::uint8_t sub, int bytes,
                     std::int64_t value) {
    const auto raw = static_cast<std::uint32_t>(value);
    return request(node,
                   {static_cast<std::uint8_t>(0x23 | (4 - bytes) << 2), low(index), high(index),
                    sub, low(raw), low(raw >> 8), low(raw >> 16), low(raw >> 24)})
        .second;
  }
  std::int64_t abort_of_read(std::uint8_t node, std::uint16_t index, std::uint8_t sub) {
    return request(node, {0x40, low(index), high(index), sub, 0, 0, 0, 0}).second;
  }
  /// The four data bytes of an expedited upload, unsigned; −1 if it aborted.
  std::int64_t read(std::uint8_t node, std::uint16_t index, std::uint8_t sub) {
    const auto [frame, code] = request(node, {0x40, low(index), high(index), sub, 0, 0, 0, 0});
    return code == 0 ? word(frame) : -1;
  }
  std::int32_t read_signed(std::uint8_t node, std::uint16_t index, std::uint8_t sub) {
    return static_cast<std::int32_t>(read(node, index, sub));
  }
  /// State bits of the statusword by SDO, 0x006F masked.
  std::int64_t state(std::uint8_t node = 1) { return read(node, 0x6041, 0) & 0x6F; }

  /// Boots, and brings a node to OperationEnabled by SDO alone, target 0; pre-operational.
  void enable_by_sdo(std::uint8_t node = 1) {
    if (now_ - start_ < EmulatedNode::kBootTime) run(400);
    write(node, 0x6060, 0, 1, 3);
    for (const int word : {0x06, 0x07, 0x0F}) {
      write(node, 0x6040, 0, 2, word);
      run(2);
    }
  }

 private:
  static std::uint8_t low(std::uint32_t x) { return static_cast<std::uint8_t>(x & 0xFF); }
  static std::uint8_t high(std::uint16_t x) { return static_cast<std::uint8_t>(x >> 8); }
  static std::int64_t word(const CanFrame& f) {
    return static_cast<std::int64_t>(static_cast<std::uint32_t>(f.data[4]) | f.data[5] << 8 |
                                     f.data[6] << 16 | static_cast<std::uint32_t>(f.data[7]) << 24);
  }

  std::pair<CanFrame, std::int64_t> request(std::uint8_t node,
                                            std::initializer_list<std::uint8_t> bytes) {
    const std::size_t before = sent_.size();
    send(CanFrame::make(0x600u + node, bytes));
    for (std::size_t i = before; i < sent_.size(); ++i) {
      const CanFrame& f = sent_[i].frame;
      if (f.id != 0x580u + node) continue;
      return {f, f.data[0] == 0x80 ? word(f) : 0};
    }
    return {{}, -1};
  }

  template <class Function>
  void take(Function function) {
    std::vector<CanFrame> out;
    function(out);
    for (const CanFrame& frame : out) sent_.push_back({now_, frame});
  }

  void turn() {
    const auto targets = drives_.wheel_targets_radps();
    for (std::size_t i = 0; i < 2; ++i) {
      wheels_.speed_radps[i] = targets[i];
      wheels_.angle_rad[i] += targets[i] * 1e-3;
    }
    drives_.set_wheels(wheels_);
  }

  Instant now_;
  Instant start_ = now_;
  EmulatedCia402 drives_;
  WheelStates wheels_;
  std::vector<Sent> sent_;
};

}  // namespace tether::test
