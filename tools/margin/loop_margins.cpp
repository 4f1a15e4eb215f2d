#include "tools/margin/loop_margins.hpp"

#include <algorithm>

#include "sim/sensor/sensor_settings.hpp"
#include "tools/margin/straight_loop.hpp"

namespace tether {
namespace {

Critical critical_burst(const StraightLoop& loop) {
  const auto prr_of = [](const ChainLink& link) {
    return link.transition[1][0] / (link.transition[0][1] + link.transition[1][0]);
  };
  const double up = prr_of(loop.uplink), down = prr_of(loop.downlink);
  const double least = std::max({1.0, (1.0 - up) / up, (1.0 - down) / down});
  return critical_value(
      [&](double burst) {
        return loop.radius(
            both_links(ChainLink::bursts(up, burst), ChainLink::bursts(down, burst)));
      },
      least, std::max(200.0, 2.0 * least), 1e-3);
}

/// Links that lose nothing but in one of two states.
bool is_bursty(const ChainLink& link) {
  return link.steps_by_packets && link.prr.size() == 2 && link.prr[0] == 1.0 &&
         link.prr[1] == 0.0 && link.transition[0][1] > 0.0 && link.transition[1][0] > 0.0;
}

}  // namespace

double longest_delay_s(double period_s) {
  constexpr double kMost_s = 0.5;
  constexpr double kMostPeriods = 12.0;  // under way: the state grows by two for each
  return std::min(kMost_s, kMostPeriods * period_s);
}

Critical critical_delay(const StraightLoop& loop, const LossChain& chain) {
  return critical_value([&](double delay_s) { return loop.radius_with_delay(chain, delay_s); }, 0.0,
                        longest_delay_s(loop.timing.period_s), 1e-4);
}

Critical critical_more_loss(const StraightLoop& loop) {
  return critical_value([&](double loss) { return loop.radius(loop.chain(loss)); }, 0.0, 0.99,
                        1e-5);
}

LoopMargins loop_margins(const Scenario& scenario) {
  refuse_margin_obstacles(scenario);
  const StraightLoop loop(scenario);
  const LossChain chain = loop.chain();
  LoopMargins m;
  m.v_mps = loop.v_mps;
  m.least_mps = loop.least_mps;
  m.period_s = loop.timing.period_s;
  m.delay_s = loop.timing.total_s();
  m.prr = chain.prr();
  m.radius_across = loop.radius(chain, LoopPart::across);
  m.radius_along = loop.radius(chain, LoopPart::along);
  m.radius = std::max(m.radius_across, m.radius_along);
  m.prr_each_way = critical_value(
      [&](double prr) {
        return loop.radius(both_links(ChainLink::independent(prr), ChainLink::independent(prr)));
      },
      0.01, 1.0, 1e-5);
  m.more_loss = critical_more_loss(loop);
  if (!loop.shared && is_bursty(loop.uplink) && is_bursty(loop.downlink))
    m.mean_burst = critical_burst(loop);
  if (!loop.plans()) {
    m.delays = {critical_delay(loop, chain), loop.steering.delay_margin_s(),
                loop.steering.varying_delay_margin_s()};
  }
  if (is_white(scenario.get<SensorSettings>())) m.rms_m = loop.rms_m(chain);
  return m;
}

}  // namespace tether
