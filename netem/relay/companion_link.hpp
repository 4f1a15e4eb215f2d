#pragma once

#include <memory>
#include <string>
#include <utility>

#include "common/base/counters.hpp"
#include "common/loop/event_loop.hpp"
#include "netem/channel/settings.hpp"
#include "netem/relay/scheduled_link.hpp"

namespace tether {

/// Carries other packets the way that a link's own go: the same conditions of the channel at the
/// same time, the same stages with the same settings. But their luck is their own (streams
/// "<vehicle>/<name>/<purpose>"), and so are their room and their bottleneck: what is offered here
/// changes nothing for the link's own packets. A channel per packet (gilbert_elliott, four_state)
/// takes no step for these: they meet the state in which the link's last packet left it.
class CompanionLink {
 public:
  using Deliver = ScheduledLink::Deliver;

  /// `of`: the link's name in the scenario; `link`, which is that, and `loop` must outlive this.
  CompanionLink(const NetemSettings& settings, std::string name, std::string of, Link& link,
                EventLoop& loop, Deliver deliver);
  CompanionLink(const CompanionLink&) = delete;
  CompanionLink& operator=(const CompanionLink&) = delete;

  void take(Packet packet) { scheduled_.take(std::move(packet)); }

  /// The link has other settings.
  void renew(const NetemSettings& after);

  const Link::Counters& counters() const { return scheduled_.link().counters(); }
  /// "<name>.offered", .lost, .overflowed and .delivered, if anything was offered.
  void list_counters(CounterList& out) const;

 private:
  std::string name_;
  std::string of_;
  NetemSettings settings_;
  std::shared_ptr<ChannelProcess> process_;
  ScheduledLink scheduled_;
};

}  // namespace tether
