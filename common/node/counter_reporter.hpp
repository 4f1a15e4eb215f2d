#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "common/base/counters.hpp"
#include "common/node/bus.hpp"
#include "common/node/event_loop.hpp"

namespace tether {

/// Publishes a node's named counters (tether.counters_t) every `period`, plus "loop.slips", and
/// "network.datagrams_dropped" if there were any.
class CounterReporter {
 public:
  /// `list` appends the node's counters; it, `loop` and `bus` must outlive the reporter, and the
  /// reporter the loop's run.
  CounterReporter(EventLoop& loop, Bus& bus, std::string node, std::string channel, Duration period,
                  std::function<void(CounterList&)> list);

  /// Publishes now, in addition to the period: for a node's end.
  void publish_now();

 private:
  EventLoop& loop_;
  Bus& bus_;
  std::string node_;
  std::string channel_;
  std::function<void(CounterList&)> list_;
  std::int64_t seq_ = 0;
};

}  // namespace tether
