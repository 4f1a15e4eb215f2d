#include "netem/models/channel_models.hpp"

#include <array>
#include <utility>

#include "netem/models/channel_use.hpp"
#include "netem/models/four_state.hpp"
#include "netem/models/gilbert_elliott.hpp"
#include "netem/models/map_process.hpp"
#include "netem/models/trace_process.hpp"

namespace tether {
namespace {

using Model = LinkConfig::Model;
using ProcessPtr = std::shared_ptr<ChannelProcess>;

Duration from_ms(double ms) { return from_seconds(ms * 1e-3); }

LinkCondition condition(const ChannelStateConfig& state) {
  return {state.prr, from_ms(state.delay_ms)};
}

std::vector<LinkCondition> conditions(const ChainConfig& chain) {
  std::vector<LinkCondition> list;
  for (std::size_t i = 0; i < chain.prr.size(); ++i) {
    list.push_back({chain.prr[i], from_ms(chain.delay_ms.empty() ? 0.0 : chain.delay_ms[i])});
  }
  return list;
}

bool same_model(const LinkConfig* before, const LinkConfig& after) {
  return before != nullptr && before->model == after.model;
}

bool same_moves(const ChainConfig& a, const ChainConfig& b) {
  return a.prr.size() == b.prr.size() && a.rates_per_s == b.rates_per_s &&
         a.probabilities == b.probabilities && a.step_s == b.step_s;
}

bool is_of_pair(const std::string& name) { return name == "uplink" || name == "downlink"; }

/// Makes the model of one link, from what is there already where that goes on.
class ModelMaker {
 public:
  ModelMaker(const NetemSettings& settings, const std::string& name)
      : config_(link_config(settings.get<ChannelSettings>(), name)),
        prefix_(link_key(name)),
        streams_(link_streams(settings, name)),
        seed_(settings.get<RunSettings>().seed) {}

  /// `model`: in use under `config`, for `offered` packets so far.
  ModelMaker& goes_on_from(const LinkModel& model, const LinkConfig& config, std::int64_t offered,
                           Instant now) {
    old_ = &model;
    before_ = &config;
    offered_ = offered;
    now_ = now;
    return *this;
  }

  void make_clocks(LinkModel& model) const {
    const bool same = same_model(before_, config_);
    if (config_.model == Model::markov) {
      const bool keep = same && before_->mean_good_s == config_.mean_good_s &&
                        before_->mean_bad_s == config_.mean_bad_s;
      model.markov = keep ? old_->markov
                          : moved_on(StateProcess::markov(config_.mean_good_s, config_.mean_bad_s,
                                                          streams_("state")));
    }
    const ChainConfig& chain = config_.chain;
    if (config_.model != Model::chain) return;
    if (same && same_moves(before_->chain, chain)) {
      model.chain = old_->chain;
    } else if (!chain.rates_per_s.empty()) {
      model.chain = moved_on(ChainClock::from_rates(
          chain.rates_per_s, prefix_ + "chain.rates_per_s", streams_("state")));
    } else if (chain.step_s > 0.0) {
      model.chain = moved_on(ChainClock::from_probabilities(
          chain.probabilities, chain.step_s, prefix_ + "chain.probabilities", streams_("state")));
    }
  }

  void make_process(LinkModel& model) const {
    switch (config_.model) {
      case Model::fixed:
        model.process = std::make_shared<FixedProcess>(condition(config_.fixed));
        break;
      case Model::markov:
        model.process = std::make_shared<MarkovProcess>(
            model.markov, std::array{condition(config_.good), condition(config_.bad)});
        break;
      case Model::gilbert_elliott:
        model.process = gilbert_elliott();
        break;
      case Model::four_state:
        model.process = four_state();
        break;
      case Model::chain:
        model.process = model.chain
                            ? std::make_shared<ChainProcess>(model.chain, conditions(config_.chain))
                            : packet_chain();
        break;
      case Model::trace:
        model.process = trace();
        break;
      case Model::map:
        model.process = map();
        break;
    }
    if (before_ != nullptr) model.process->advance(now_);
  }

 private:
  template <class Clock>
  std::shared_ptr<Clock> moved_on(Clock clock) const {
    if (before_ != nullptr) clock.advance(now_);
    return std::make_shared<Clock>(std::move(clock));
  }

  /// What `Process` the link has now; null if another.
  template <class Process>
  std::shared_ptr<Process> present() const {
    return before_ == nullptr ? nullptr : std::dynamic_pointer_cast<Process>(old_->process);
  }

  /// "state", from the draw for the next packet on.
  RandomEngine packet_stream() const {
    RandomEngine random = streams_("state");
    random.discard(static_cast<std::uint64_t>(offered_));
    return random;
  }

  ProcessPtr gilbert_elliott() const {
    const GilbertElliottConfig& c = config_.gilbert_elliott;
    const GilbertElliott model{c.p.value(), c.r.value(), c.one_minus_h, c.one_minus_k};
    const Duration delay = from_ms(config_.fixed.delay_ms);
    if (const auto old = present<GilbertElliottProcess>()) {
      return std::make_shared<GilbertElliottProcess>(model, delay, *old);
    }
    return std::make_shared<GilbertElliottProcess>(model, delay, packet_stream());
  }

  ProcessPtr four_state() const {
    const FourStateConfig& c = config_.four_state;
    const double p13 = c.p13.value();
    const FourState model{p13, c.p31.value_or(1.0 - p13), c.p32, c.p23, c.p14};
    const Duration delay = from_ms(config_.fixed.delay_ms);
    if (const auto old = present<FourStateProcess>()) {
      return std::make_shared<FourStateProcess>(model, delay, *old);
    }
    return std::make_shared<FourStateProcess>(model, delay, packet_stream());
  }

  ProcessPtr packet_chain() const {
    const ChainConfig& c = config_.chain;
    const std::string key = prefix_ + "chain.probabilities";
    const auto old = present<PacketChainProcess>();
    if (old && old->states() == c.prr.size()) {
      return std::make_shared<PacketChainProcess>(c.probabilities, conditions(c), key, *old);
    }
    return std::make_shared<PacketChainProcess>(c.probabilities, conditions(c), key,
                                                packet_stream());
  }

  ProcessPtr trace() const {
    if (same_model(before_, config_) && before_->trace == config_.trace) return old_->process;
    return make_trace_process(config_.trace, prefix_ + "trace.");
  }

  ProcessPtr map() const {
    if (same_model(before_, config_) && before_->map == config_.map) return old_->process;
    // What stands in the way does so for every link: the streams are not the link's.
    ProcessPtr made =
        make_map_process(config_.map, prefix_ + "map.", [seed = seed_](std::string_view place) {
          return random_stream(seed, "shadowing/" + std::string(place));
        });
    const auto old = present<MapProcess>();
    if (const auto where = old ? old->position() : std::nullopt) {
      made->on_position(where->x_m, where->y_m, now_);
    }
    return made;
  }

  const LinkConfig& config_;
  std::string prefix_;
  LinkStreams streams_;
  std::uint64_t seed_;
  const LinkModel* old_ = nullptr;
  const LinkConfig* before_ = nullptr;
  std::int64_t offered_ = 0;
  Instant now_{};
};

/// Both links' models; the downlink's from the uplink's where they share the state.
void make_pair(const ChannelSettings& channel, const ModelMaker& up, const ModelMaker& down,
               ChannelModels& models) {
  up.make_clocks(models.uplink);
  up.make_process(models.uplink);
  const Model model = channel.uplink.model;
  if (channel.shared_state && (model == Model::trace || model == Model::map)) {
    models.downlink = models.uplink;
    return;
  }
  if (channel.shared_state) {
    models.downlink.markov = models.uplink.markov;
    models.downlink.chain = models.uplink.chain;
  } else {
    down.make_clocks(models.downlink);
  }
  down.make_process(models.downlink);
}

}  // namespace

const LinkModel& ChannelModels::of(const std::string& name) const {
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
      const ModelMaker make(settings, name);
      make.make_clocks(models.links[name]);
      make.make_process(models.links[name]);
    } else if (!models.uplink.process) {
      make_pair(settings.get<ChannelSettings>(), {settings, "uplink"}, {settings, "downlink"},
                models);
    }
  }
  return models;
}

ChannelModels renew_models(const ChannelModels& models, const NetemSettings& before,
                           const NetemSettings& after, const ChannelMoment& moment) {
  static const LinkConfig kNone;
  const auto maker = [&](const std::string& name, bool parts) {
    ModelMaker make(after, name);
    const auto offered = moment.offered.find(name);
    make.goes_on_from(models.of(name),
                      parts ? kNone : link_config(before.get<ChannelSettings>(), name),
                      offered == moment.offered.end() ? 0 : offered->second, moment.now);
    return make;
  };
  ChannelModels made;
  if (models.uplink.process) {
    // A state that the links shared until now is the uplink's: not the downlink's to go on from.
    const auto& channel = after.get<ChannelSettings>();
    const bool parts = before.get<ChannelSettings>().shared_state && !channel.shared_state;
    make_pair(channel, maker("uplink", false), maker("downlink", parts), made);
  }
  for (const auto& [name, model] : models.links) {
    const ModelMaker make = maker(name, false);
    make.make_clocks(made.links[name]);
    make.make_process(made.links[name]);
  }
  return made;
}

}  // namespace tether
