#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "can_bridge/bus/socket_can_port.hpp"
#include "common/node/real_time_loop.hpp"

namespace tether::test {

inline CanFrame frame_with(std::uint32_t id, std::uint8_t first) {
  return CanFrame::make(id, {first});
}

/// A SocketCanPort with its loop, and what came of it.
struct Node {
  explicit Node(const std::string& interface, std::vector<CanFilter> filters = {{0x200, 0x780}})
      : port(interface, loop) {
    port.on_frame(std::move(filters), [this](const CanFrame& f) { frames.push_back(f); });
    port.on_state([this](CanState s) { states.push_back(s); });
  }

  /// Lets the port work until `done`, at most 5 s.
  template <class Done>
  bool until(Done done) {
    const Instant end = loop.now() + std::chrono::seconds{5};
    while (!done() && loop.now() < end) loop.run_until(loop.now() + std::chrono::milliseconds{5});
    return done();
  }
  bool until_state(CanState s) {
    return until([&] { return port.state() == s; });
  }
  void run(Duration time) { loop.run_until(loop.now() + time); }
  std::int64_t counter(const std::string& name) {
    CounterList list;
    port.list(list);
    return std::map<std::string, std::int64_t>(list.begin(), list.end()).at(name);
  }

  RealTimeLoop loop{RealTimeLoop::wall_utime_us()};
  SocketCanPort port;
  std::vector<CanFrame> frames;
  std::vector<CanState> states;
};

}  // namespace tether::test
