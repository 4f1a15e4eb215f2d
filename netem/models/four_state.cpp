#include "netem/models/four_state.hpp"

namespace tether {
namespace {

int next_state(const FourState& m, int state, double luck) {
  switch (state) {
    case 1:
      if (luck < m.p14) return 4;
      return luck < m.p14 + m.p13 ? 3 : 1;
    case 2:
      return luck < m.p23 ? 3 : 2;
    case 3:
      if (luck < m.p32) return 2;
      return luck < m.p32 + m.p31 ? 1 : 3;
    default:
      return 1;
  }
}

}  // namespace

FourStateProcess::FourStateProcess(const FourState& model, Duration delay, RandomEngine random)
    : model_(model), delay_(delay), random_(random) {}

FourStateProcess::FourStateProcess(const FourState& model, Duration delay,
                                   const FourStateProcess& before)
    : model_(model), delay_(delay), random_(before.random_), state_(before.state_) {}

LinkCondition FourStateProcess::on_packet(Instant) {
  state_ = next_state(model_, state_, uniform_01(random_));
  return condition();
}

LinkCondition FourStateProcess::condition() const { return {state_ <= 2 ? 1.0 : 0.0, delay_}; }

}  // namespace tether
