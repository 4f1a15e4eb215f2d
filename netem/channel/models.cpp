#include "netem/channel/models.hpp"

#include <utility>

#include "netem/channel/use.hpp"
#include "netem/models/kinds.hpp"

namespace tether {
namespace {

bool is_of_pair(const std::string& name) { return name == "uplink" || name == "downlink"; }

ProcessNeeds needs_of(const NetemSettings& settings, const std::string& name) {
  return {link_config(settings.get<ChannelSettings>(), name), link_key(name),
          link_streams(settings, name), settings.get<RunSettings>().seed};
}

ProcessPtr make_process(const ProcessNeeds& needs) {
  ProcessPtr process = kind_of(needs.link).make(needs);
  if (needs.before != nullptr) process->advance(needs.now);
  return process;
}

/// Both links' models; the downlink's from the uplink's where they share the state.
void make_pair(bool shared, const ProcessNeeds& up, ProcessNeeds down, ChannelModels& models) {
  models.uplink = make_process(up);
  if (shared) down.shared = models.uplink;
  models.downlink = make_process(down);
}

}  // namespace

const ProcessPtr& ChannelModels::of(const std::string& name) const {
  return name == "uplink" ? uplink : name == "downlink" ? downlink : links.at(name);
}

LinkStreams link_streams(const NetemSettings& settings, const std::string& name) {
  const std::string link =
      settings.get<VehicleSettings>().name + (is_of_pair(name) ? "/" : "/links/") + name + "/";
  return [seed = settings.get<RunSettings>().seed, link](std::string_view purpose) {
    return random_stream(seed, link + std::string(purpose));
  };
}

ChannelModels make_models(const NetemSettings& settings, const std::vector<std::string>& names) {
  ChannelModels models;
  for (const std::string& name : names) {
    if (!is_of_pair(name)) {
      models.links[name] = make_process(needs_of(settings, name));
    } else if (!models.uplink) {
      make_pair(settings.get<ChannelSettings>().shared_state, needs_of(settings, "uplink"),
                needs_of(settings, "downlink"), models);
    }
  }
  return models;
}

ChannelModels renew_models(const ChannelModels& models, const NetemSettings& before,
                           const NetemSettings& after, const ChannelMoment& moment) {
  static const LinkConfig kNone;
  const auto needs = [&](const std::string& name, bool parts) {
    ProcessNeeds of = needs_of(after, name);
    of.before = parts ? &kNone : &link_config(before.get<ChannelSettings>(), name);
    of.present = models.of(name);
    const auto offered = moment.offered.find(name);
    of.offered = offered == moment.offered.end() ? 0 : offered->second;
    of.now = moment.now;
    return of;
  };
  ChannelModels made;
  if (models.uplink) {
    // A state that the links shared until now is the uplink's: not the downlink's to go on from.
    const bool shared = after.get<ChannelSettings>().shared_state;
    const bool parts = before.get<ChannelSettings>().shared_state && !shared;
    make_pair(shared, needs("uplink", false), needs("downlink", parts), made);
  }
  for (const auto& [name, model] : models.links) {
    made.links[name] = make_process(needs(name, false));
  }
  return made;
}

}  // namespace tether
