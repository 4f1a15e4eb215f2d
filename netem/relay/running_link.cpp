#include "netem/relay/running_link.hpp"

#include <utility>

namespace tether {

RunningLink::RunningLink(std::string name, Link link, EventLoop& loop, Duration report_period,
                         Deliver deliver, Report report)
    : name_(std::move(name)),
      scheduled_(std::move(link), loop, std::move(deliver)),
      loop_(loop),
      report_(std::move(report)) {
  loop_.every(kStart, report_period, Priority::observer, [this](Instant) { this->report(); });
  scheduled_.link().process().advance(loop_.now());
  watch_state();
}

void RunningLink::changed() {
  ++watch_;
  link().process().advance(loop_.now());
  watch_state();
  report();
}

void RunningLink::watch_state() {
  const Instant next = link().process().next_transition();
  if (next == Instant::max()) return;
  loop_.at(next, Priority::observer, [this, watch = watch_](Instant scheduled) {
    if (watch != watch_) return;
    link().process().advance(scheduled);
    report();
    watch_state();
  });
}

void RunningLink::report() {
  const Link::Counters& c = link().counters();
  const DelayHistogram& delays = link().delays();
  const LinkCondition condition = link().process().condition();

  link_report_t message{};
  message.utime = to_utime(loop_.now());
  message.seq = report_seq_++;
  message.link = name_;
  message.state = link().process().state();
  message.state_prr = condition.prr;
  message.state_delay_ms = to_milliseconds(condition.delay);
  message.offered = c.offered + c.duplicated;
  message.lost = c.lost + c.outage_dropped;
  message.overflowed = c.overflowed;
  message.delivered = c.delivered;
  message.in_flight = link().in_flight();
  message.delivered_bytes = c.delivered_bytes;
  message.delay_ms_mean = to_milliseconds(delays.mean());
  message.delay_ms_p50 = to_milliseconds(delays.quantile(0.50));
  message.delay_ms_p90 = to_milliseconds(delays.quantile(0.90));
  message.delay_ms_p99 = to_milliseconds(delays.quantile(0.99));
  message.delay_ms_max = to_milliseconds(delays.max());
  report_(message);
}

void RunningLink::list_counters(CounterList& out) const {
  const Link::Counters& c = link().counters();
  out.emplace_back(name_ + ".offered", c.offered);
  out.emplace_back(name_ + ".lost", c.lost);
  out.emplace_back(name_ + ".overflowed", c.overflowed);
  out.emplace_back(name_ + ".delivered", c.delivered);
  const std::pair<const char*, std::int64_t> rare[] = {{".outage_dropped", c.outage_dropped},
                                                       {".duplicated", c.duplicated},
                                                       {".corrupted", c.corrupted},
                                                       {".reordered", c.reordered}};
  for (const auto& [name, value] : rare) {
    if (value > 0) out.emplace_back(name_ + name, value);
  }
}

}  // namespace tether
