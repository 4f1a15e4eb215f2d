#include "netem/make_links.hpp"

#include <optional>
#include <utility>

#include "netem/four_state.hpp"
#include "netem/gilbert_elliott.hpp"
#include "netem/map_process.hpp"
#include "netem/markov_chain.hpp"
#include "netem/state_process.hpp"
#include "netem/trace_process.hpp"

namespace tether {
namespace {

using Model = LinkConfig::Model;

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

/// What moves in time, whichever link it serves; null for other models.
struct Clocks {
  std::shared_ptr<StateProcess> markov;
  std::shared_ptr<ChainClock> chain;
};

Clocks make_clocks(const LinkConfig& config, const std::string& prefix,
                   const LinkStreams& streams) {
  Clocks clocks;
  if (config.model == Model::markov) {
    clocks.markov = std::make_shared<StateProcess>(
        StateProcess::markov(config.mean_good_s, config.mean_bad_s, streams("state")));
  }
  const ChainConfig& chain = config.chain;
  if (config.model == Model::chain && !chain.rates_per_s.empty()) {
    clocks.chain = std::make_shared<ChainClock>(
        ChainClock::from_rates(chain.rates_per_s, prefix + "chain.rates_per_s", streams("state")));
  } else if (config.model == Model::chain && chain.step_s > 0.0) {
    clocks.chain = std::make_shared<ChainClock>(ChainClock::from_probabilities(
        chain.probabilities, chain.step_s, prefix + "chain.probabilities", streams("state")));
  }
  return clocks;
}

std::shared_ptr<ChannelProcess> make_process(const LinkConfig& config, const std::string& prefix,
                                             const LinkStreams& streams, const Clocks& clocks) {
  const Duration delay = from_ms(config.fixed.delay_ms);
  switch (config.model) {
    case Model::fixed:
      return std::make_shared<FixedProcess>(condition(config.fixed));
    case Model::markov:
      return std::make_shared<MarkovProcess>(
          clocks.markov, std::array{condition(config.good), condition(config.bad)});
    case Model::gilbert_elliott: {
      const GilbertElliottConfig& c = config.gilbert_elliott;
      const GilbertElliott model{c.p.value(), c.r.value(), c.one_minus_h, c.one_minus_k};
      return std::make_shared<GilbertElliottProcess>(model, delay, streams("state"));
    }
    case Model::four_state: {
      const FourStateConfig& c = config.four_state;
      const double p13 = c.p13.value();
      const FourState model{p13, c.p31.value_or(1.0 - p13), c.p32, c.p23, c.p14};
      return std::make_shared<FourStateProcess>(model, delay, streams("state"));
    }
    case Model::chain:
      if (clocks.chain) {
        return std::make_shared<ChainProcess>(clocks.chain, conditions(config.chain));
      }
      return std::make_shared<PacketChainProcess>(config.chain.probabilities,
                                                  conditions(config.chain),
                                                  prefix + "chain.probabilities", streams("state"));
    case Model::trace:
      return make_trace_process(config.trace, prefix + "trace.");
    case Model::map:
      return make_map_process(config.map, prefix + "map.", streams("shadowing"));
  }
  return nullptr;
}

}  // namespace

LinkStreams link_streams(const Scenario& scenario, const std::string& name) {
  const std::string link = scenario.vehicle.name + "/" + name + "/";
  return [seed = scenario.run.seed, link](std::string_view purpose) {
    return random_stream(seed, link + std::string(purpose));
  };
}

std::shared_ptr<ChannelProcess> make_process(const LinkConfig& config, const std::string& prefix,
                                             const LinkStreams& streams) {
  return make_process(config, prefix, streams, make_clocks(config, prefix, streams));
}

LinkPair make_links(const Scenario& scenario) {
  const bool shared = scenario.channel.shared_state;
  const LinkConfig &up = scenario.channel.uplink, &down = scenario.channel.downlink;
  const std::string up_prefix = "channel.uplink.", down_prefix = "channel.downlink.";
  const LinkStreams up_streams = link_streams(scenario, "uplink");
  const LinkStreams down_streams = link_streams(scenario, "downlink");
  const Clocks up_clocks = make_clocks(up, up_prefix, up_streams);
  const Clocks down_clocks = shared ? up_clocks : make_clocks(down, down_prefix, down_streams);
  const auto up_process = make_process(up, up_prefix, up_streams, up_clocks);
  const bool same = shared && (up.model == Model::trace || up.model == Model::map);
  const auto down_process =
      same ? up_process : make_process(down, down_prefix, down_streams, down_clocks);
  return {Link(up, up_process, up_streams, load_delay_table(up.jitter)),
          Link(down, down_process, down_streams, load_delay_table(down.jitter))};
}

std::vector<Link> make_links(const Scenario& scenario, const std::vector<std::string>& names) {
  std::optional<LinkPair> pair;
  std::vector<Link> links;
  for (const std::string& name : names) {
    if (name == "uplink" || name == "downlink") {
      if (!pair) pair.emplace(make_links(scenario));
      links.push_back(std::move(name == "uplink" ? pair->uplink : pair->downlink));
    } else {
      const LinkConfig& config = scenario.channel.links.at(name);
      const LinkStreams streams = link_streams(scenario, "links/" + name);
      const std::string prefix = "channel.links." + name + ".";
      links.emplace_back(config, make_process(config, prefix, streams), streams,
                         load_delay_table(config.jitter));
    }
  }
  return links;
}

}  // namespace tether
