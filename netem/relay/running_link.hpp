#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <tether/link_report_t.hpp>
#include <utility>

#include "common/base/counters.hpp"
#include "common/loop/event_loop.hpp"
#include "netem/relay/scheduled_link.hpp"

namespace tether {

/// A link on a loop that reports every period and at each change of its channel's state. Stays
/// where it is: tasks on the loop refer to it.
class RunningLink {
 public:
  using Deliver = ScheduledLink::Deliver;
  using Report = std::function<void(const link_report_t&)>;

  RunningLink(std::string name, Link link, EventLoop& loop, Duration report_period, Deliver deliver,
              Report report);
  RunningLink(const RunningLink&) = delete;
  RunningLink& operator=(const RunningLink&) = delete;

  /// Offers a packet to the link now.
  void take(Packet packet) { scheduled_.take(std::move(packet)); }

  /// The link has got other settings: restarts watching its channel's state, and reports now.
  void changed();

  /// Makes and hands over a report now.
  void report();

  const std::string& name() const { return name_; }
  Link& link() { return scheduled_.link(); }
  const Link& link() const { return scheduled_.link(); }

  /// "<name>.offered" and so on; rare ones only if they happened.
  void list_counters(CounterList& out) const;

 private:
  void watch_state();

  std::string name_;
  ScheduledLink scheduled_;
  EventLoop& loop_;
  Report report_;
  std::int64_t report_seq_ = 0;
  std::int64_t watch_ = 0;  // the one that counts; tasks of earlier ones do nothing
};

}  // namespace tether
