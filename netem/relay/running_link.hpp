#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <tether/link_report_t.hpp>

#include "common/base/counters.hpp"
#include "common/loop/event_loop.hpp"
#include "netem/link/link.hpp"

namespace tether {

/// A link on a loop: takes packets when they come, hands them over when they are due, and reports
/// every period and at each change of its channel's state. Stays where it is: tasks on the loop
/// refer to it.
class RunningLink {
 public:
  using Deliver = std::function<void(const Packet&)>;
  using Report = std::function<void(const link_report_t&)>;

  RunningLink(std::string name, Link link, EventLoop& loop, Duration report_period, Deliver deliver,
              Report report);
  RunningLink(const RunningLink&) = delete;
  RunningLink& operator=(const RunningLink&) = delete;

  /// Offers a packet to the link now.
  void take(Packet packet);

  /// The link has got other settings: watches its channel's state anew, and reports now.
  void changed();

  /// Makes and hands over a report now.
  void report();

  const std::string& name() const { return name_; }
  Link& link() { return link_; }
  const Link& link() const { return link_; }

  /// "<name>.offered" and so on; rare ones only if they happened.
  void list_counters(CounterList& out) const;

 private:
  void deliver_at(Instant departure);
  void deliver_ready();
  void watch_state();

  std::string name_;
  Link link_;
  EventLoop& loop_;
  Deliver deliver_;
  Report report_;
  std::int64_t report_seq_ = 0;
  std::int64_t watch_ = 0;  // the one that counts; tasks of earlier ones do nothing
};

}  // namespace tether
