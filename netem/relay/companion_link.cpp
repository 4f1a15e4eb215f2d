#include "netem/relay/companion_link.hpp"

#include <utility>

#include "common/base/errors.hpp"
#include "netem/channel/models.hpp"
#include "netem/channel/use.hpp"
#include "netem/stages/kinds.hpp"

namespace tether {
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

}  // namespace tether
