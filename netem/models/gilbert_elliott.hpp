#pragma once

#include <optional>
#include <string>

#include "common/base/random.hpp"
#include "netem/link/channel_process.hpp"
#include "netem/statistics/channel_expectation.hpp"

namespace tether {

/// Loss in bursts (Gilbert, Bell System Technical Journal 39(5), 1960; Elliott, 42(5), 1963),
/// exactly as `tc qdisc … netem loss gemodel p r 1-h 1-k` (tc-netem(8); loss_gilb_ell() of
/// net/sched/sch_netem.c, Linux 6.18): the first packet meets the good state; each packet is lost
/// with the loss probability of the state *before* the step that it triggers, 1−k in the good state
/// and 1−h in the bad one; the step goes good → bad with p, bad → good with r. All in 0..1.
///
/// With e_G = 1−k, e_B = 1−h, π_B = p/(p+r), π_G = r/(p+r): loss ratio P = π_G e_G + π_B e_B,
/// autocovariance at lag k ≥ 1: π_G π_B (e_B − e_G)² (1−p−r)^k; the rest in loss_statistics.hpp.
struct GilbertElliott {
  double p = 0.0;
  double r = 1.0;
  double one_minus_h = 1.0;
  double one_minus_k = 0.0;
};

/// A link with this model gives p and r, or prr and mean_burst.
struct GilbertElliottConfig {
  std::optional<double> p;           ///< good → bad, per packet
  std::optional<double> r;           ///< bad → good, per packet
  double one_minus_h = 1.0;          ///< loss probability in the bad state
  double one_minus_k = 0.0;          ///< loss probability in the good state
  std::optional<double> prr;         ///< instead: reception ratio and …
  std::optional<double> mean_burst;  ///< … mean length of loss bursts, packets

  bool operator==(const GilbertElliottConfig&) const = default;
};

/// The chain with e_B = 1, e_G = 0 that has this reception ratio (0 < prr < 1) and mean length of
/// loss bursts L in packets: r = 1/L, p = (1−PRR)/(PRR·L). That needs
/// mean_burst >= shortest_mean_burst(prr), where p = 1 or r = 1.
GilbertElliott gilbert_from_burst(double prr, double mean_burst);

/// max(1, (1−PRR)/PRR).
double shortest_mean_burst(double prr);

/// Expected statistics of packets.
ChannelExpectation expect_gilbert_elliott(const GilbertElliott& model,
                                          DelayCdf good_delay = constant_delay(0.0),
                                          DelayCdf bad_delay = constant_delay(0.0));

/// ` loss gemodel p r 1-h 1-k` of tc-netem(8), with an independent loss behind it.
std::string tc_gemodel(const GilbertElliott& model, double more_loss);

/// One draw per packet from `random`; the link draws the loss from its own stream.
/// state(): 0 good, 1 bad.
class GilbertElliottProcess final : public ChannelProcess {
 public:
  /// `delay`: of the packets that get through, in both states.
  GilbertElliottProcess(const GilbertElliott& model, Duration delay, RandomEngine random);
  /// Goes on in the state and with the stream of `before`.
  GilbertElliottProcess(const GilbertElliott& model, Duration delay,
                        const GilbertElliottProcess& before);

  void advance(Instant) override {}
  LinkCondition on_packet(Instant now) override;
  LinkCondition condition() const override;
  int state() const override { return bad_ ? 1 : 0; }

 private:
  GilbertElliott model_;
  Duration delay_;
  RandomEngine random_;
  bool bad_ = false;
};

}  // namespace tether
