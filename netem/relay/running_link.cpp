#include "netem/relay/running_link.hpp"

#include <algorithm>
#include <iterator>
#include <limits>
#include <utility>

#include "common/base/errors.hpp"
#include "netem/channel/models.hpp"
#include "netem/channel/use.hpp"
#include "netem/medium/divergence.hpp"
#include "netem/stages/kinds.hpp"

namespace tether {

ScheduledLink::ScheduledLink(Link link, EventLoop& loop, Deliver deliver)
    : link_(std::move(link)), loop_(loop), deliver_(std::move(deliver)) {}

void ScheduledLink::take(Packet packet) {
  const Instant departure = link_.push(loop_.now(), std::move(packet));
  const Instant copy_departure = link_.copy_departure();
  deliver_at(departure);
  deliver_at(copy_departure);
}

void ScheduledLink::deliver_at(Instant departure) {
  if (departure <= loop_.now()) {
    deliver_ready();
  } else if (departure != Instant::max()) {
    loop_.at(departure, Priority::delivery, [this](Instant) { deliver_ready(); });
  }
}

void ScheduledLink::deliver_ready() { link_.pop_ready(loop_.now(), deliver_); }

namespace {

/// The conditions of another link's channel, without a step of its own.
class Beside final : public ChannelProcess {
 public:
  explicit Beside(Link& link) : link_(link) {}

  void advance(Instant now) override { link_.process().advance(now); }
  LinkCondition condition() const override { return link_.process().condition(); }
  int state() const override { return link_.process().state(); }

 private:
  Link& link_;
};

const LinkConfig& config_of(const NetemSettings& settings, const std::string& of) {
  return link_config(settings.get<ChannelSettings>(), of);
}

LinkStreams streams_of(const NetemSettings& settings, const std::string& name) {
  return
      [seed = settings.get<RunSettings>().seed,
       prefix = settings.get<VehicleSettings>().name + "/" + name + "/"](std::string_view purpose) {
        return random_stream(seed, prefix + std::string(purpose));
      };
}

}  // namespace

CompanionLink::CompanionLink(const NetemSettings& settings, std::string name, std::string of,
                             Link& link, EventLoop& loop, Deliver deliver)
    : name_(std::move(name)),
      of_(std::move(of)),
      settings_(settings),
      process_(std::make_shared<Beside>(link)),
      scheduled_({make_stages(config_of(settings, of_), link_key(of_), streams_of(settings, name_)),
                  process_},
                 loop, std::move(deliver)) {}

void CompanionLink::renew(const NetemSettings& after) {
  try {
    Link& link = scheduled_.link();
    link.apply(renewed_stages(link, config_of(settings_, of_), config_of(after, of_), link_key(of_),
                              streams_of(after, name_)),
               process_);
    settings_ = after;
  } catch (const UsageError&) {
    // The link itself has just read the same files: this one vanished in between. The stages stay.
  }
}

void CompanionLink::list_counters(CounterList& out) const {
  const Link::Counters& c = counters();
  if (c.offered == 0) return;
  out.emplace_back(name_ + ".offered", c.offered);
  out.emplace_back(name_ + ".lost", c.lost + c.outage_dropped);
  out.emplace_back(name_ + ".overflowed", c.overflowed);
  out.emplace_back(name_ + ".delivered", c.delivered);
}

RunningMedium::RunningMedium(const MediumSettings& settings, std::uint64_t seed, EventLoop& loop)
    : loop_(loop),
      medium_(SharedMedium::make(
          settings, seed, [this](const PacketFateOnAir& fate) { ended(fate); },
          [this](std::uint64_t id) { return under_way_.at(id).value; })),
      has_values_(settings.serve == ScheduledRules::Serve::most_valuable) {}

std::size_t RunningMedium::add_vehicle(const std::string& name) {
  return medium_ ? medium_->add_vehicle(name) : 0;
}

void RunningMedium::send(std::size_t vehicle, Way way, Packet packet, const Deliver& deliver) {
  const auto bytes = static_cast<int>(datagram_bytes(packet.channel, std::ssize(packet.bytes)));
  send(vehicle, way, std::move(packet), bytes, deliver);
}

void RunningMedium::send(std::size_t vehicle, Way way, Packet packet, int bytes,
                         const Deliver& deliver) {
  if (!medium_) return deliver(std::move(packet));
  const std::uint64_t id = next_id_++;
  const double value = has_values_ ? value_of(packet) : 0.0;
  under_way_.emplace(id, UnderWay{std::move(packet), &deliver, value});
  medium_->send(loop_.now(), vehicle, way, id, bytes);
  wake();
}

void RunningMedium::on_position(std::size_t vehicle, double x_m, double y_m) {
  if (!wants_position()) return;
  medium_->on_position(vehicle, x_m, y_m, loop_.now());
  wake();
}

/// At the medium's next event, unless that is planned already.
void RunningMedium::wake() {
  const Instant next = medium_->next_event();
  if (next >= wakes_at_) return;
  wakes_at_ = next;
  loop_.at(std::max(next, loop_.now()), Priority::delivery, [this, next](Instant now) {
    if (next != wakes_at_) return;
    wakes_at_ = Instant::max();
    medium_->advance(now);
    wake();
  });
}

void RunningMedium::ended(const PacketFateOnAir& fate) {
  auto packet = under_way_.extract(fate.id);
  if (!fate.delivered) return;
  if (has_values_) know(packet.mapped().packet);
  const auto hand_on = [arrived = std::move(packet.mapped())](Instant) {
    (*arrived.deliver)(arrived.packet);
  };
  if (fate.at <= loop_.now()) return hand_on(loop_.now());
  loop_.at(fate.at, Priority::delivery, hand_on);
}

double RunningMedium::value_of(const Packet& packet) const {
  const auto known = known_.find(packet.channel);
  return known == known_.end() ? std::numeric_limits<double>::infinity()
                               : divergence_m(packet.bytes, known->second.bytes);
}

/// Updates the value of other packets under way to the same receiver.
void RunningMedium::know(const Packet& delivered) {
  known_[delivered.channel] = delivered;
  for (auto& [id, other] : under_way_) {
    if (other.packet.channel == delivered.channel) other.value = value_of(other.packet);
  }
}

void RunningMedium::list_counters(CounterList& out) const {
  if (!medium_) return;
  // Others send while none of our packets is under way; what is sent now may still collide with
  // one.
  medium_->advance(loop_.now() - Duration{1});
  medium_->list(out);
}

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
