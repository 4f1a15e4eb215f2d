#include "netem/stages/kinds.hpp"

namespace tether {
namespace {

/// Loses packets with the probability that the channel's model says.
class State final : public LinkStage {
 public:
  explicit State(RandomEngine random) : random_(random) {}

  void meet(OfferedPacket& offered) override {
    if (uniform_01(random_) >= offered.condition.prr) offered.lose();
  }

 private:
  RandomEngine random_;
};

}  // namespace

LinkStageKind state_stage() {
  LinkStageKind kind{.name = "state"};
  kind.make = [](const StageNeeds& needs) -> StagePtr {
    const auto* present = needs.present_as<State>();
    return present != nullptr ? std::make_unique<State>(*present)
                              : std::make_unique<State>(needs.streams("loss"));
  };
  return kind;
}

}  // namespace tether
