#pragma once

#include <optional>

#include "common/base/random.hpp"
#include "netem/link/channel_process.hpp"
#include "netem/statistics/channel_expectation.hpp"

namespace tether {

/// The 4-state model of Salsano, Ludovici, Ordine and Giannuzzi ("Definition of a general and
/// intuitive loss model for packet networks and its implementation in the Netem module in the Linux
/// kernel", 2012). It is exactly that of `tc qdisc … netem loss state p13 p31 p32 p23 p14`
/// (loss_4state() of net/sched/sch_netem.c): states 1 received in a gap, 2 received in a burst, 3
/// lost in a burst, 4 lost alone. Starts in 1; each packet triggers a step and its fate is that of
/// the *new* state: lost in 3 and 4. From 1 to 4 with p14, to 3 with p13; from 2 to 3 with p23;
/// from 3 to 2 with p32, to 1 with p31; from 4 always back to 1.
///
/// All in 0..1; p13 + p14 <= 1 and p31 + p32 <= 1.
struct FourState {
  double p13 = 0.0;
  double p31 = 1.0;
  double p32 = 0.0;
  double p23 = 1.0;
  double p14 = 0.0;
};

/// The model's keys in a link.
struct FourStateConfig {
  std::optional<double> p13;  ///< must be given
  std::optional<double> p31;  ///< 1 − p13 if not given
  double p32 = 0.0;
  double p23 = 1.0;
  double p14 = 0.0;

  bool operator==(const FourStateConfig&) const = default;
};

/// Expected statistics of packets.
ChannelExpectation expect_four_state(const FourState& model, DelayCdf delay = constant_delay(0.0));

/// One draw per packet from `random`. state(): 0 … 3 for the model's 1 … 4.
class FourStateProcess final : public ChannelProcess {
 public:
  /// `delay`: of the packets that get through.
  FourStateProcess(const FourState& model, Duration delay, RandomEngine random);
  /// Goes on in the state and with the stream of `before`.
  FourStateProcess(const FourState& model, Duration delay, const FourStateProcess& before);

  void advance(Instant) override {}
  LinkCondition on_packet(Instant now) override;
  LinkCondition condition() const override;
  int state() const override { return state_ - 1; }

 private:
  FourState model_;
  Duration delay_;
  RandomEngine random_;
  int state_ = 1;
};

}  // namespace tether
