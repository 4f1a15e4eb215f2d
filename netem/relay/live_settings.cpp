#include "netem/relay/live_settings.hpp"

#include <utility>

#include "common/bus/message_io.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "netem/channel/settings.hpp"

namespace tether {

LiveSettings::LiveSettings(const NetemSettings& settings, ChannelModels models,
                           const ChannelUse& use, std::vector<RunningLink*> links, EventLoop& loop,
                           const std::vector<Bus*>& buses, std::function<void()> on_change)
    : loop_(loop),
      channels_(settings.get<VehicleSettings>().name),
      links_(std::move(links)),
      on_change_(std::move(on_change)),
      control_(settings, std::move(models), use),
      requests_(
          loop, buses, channels_,
          [this](const std::vector<std::string>& settings) { return control_.reading(settings); },
          [this](const std::vector<std::string>& settings) { return change(settings); }) {
  try_changes(settings, use);
  schedule_changes(settings, *buses.front());
}

void LiveSettings::schedule_changes(const NetemSettings& settings, Bus& bus) {
  std::int64_t seq = 0;
  for (const ChannelSettings::Change& change : settings.get<ChannelSettings>().changes) {
    // Before anything else that is sent at this instant.
    loop_.at(kStart + from_seconds(change.at_s), Priority::physics,
             [this, &bus, request = setting_request(0, seq++, change.settings)](Instant) mutable {
               request.utime = to_utime(loop_.now());
               publish(bus, channels_.net_set, request);
               if (!bus.hears_itself()) requests_.take(request);
             });
  }
}

std::vector<ChannelSetting> LiveSettings::change(const std::vector<std::string>& settings) {
  if (settings.empty()) return control_.settings();
  std::vector<Link*> links;
  for (RunningLink* running : links_) links.push_back(&running->link());
  auto changed = control_.change(settings, loop_.now(), links);
  on_change_();
  for (RunningLink* running : links_) running->changed();
  return changed;
}

}  // namespace tether
