#include "can_bridge/emulated/safety_inputs.hpp"

#include <algorithm>

namespace tether {

EmulatedSafetyInputs::EmulatedSafetyInputs(const std::vector<SafetyInputConfig>& inputs)
    : acts_(inputs.size(), Act::clear) {
  for (const SafetyInputConfig& input : inputs) {
    const auto* const can = std::get_if<SafetyInputConfig::Can>(&input.wiring);
    inputs_.push_back(can != nullptr ? std::optional(*can) : std::nullopt);
    if (can == nullptr) continue;
    const Duration period = std::chrono::milliseconds(can->timeout_ms / 3);
    const auto sender = std::ranges::find(senders_, can->id, &Sender::id);
    if (sender == senders_.end()) {
      senders_.push_back({can->id, period});
    } else {
      sender->period = std::min(sender->period, period);
    }
  }
}

bool EmulatedSafetyInputs::has(std::int64_t number) const {
  return number >= 0 && number <= static_cast<std::int64_t>(acts_.size());
}

void EmulatedSafetyInputs::set(std::int64_t number, Act act) {
  for (std::size_t i = 0; i < acts_.size(); ++i) {
    if (number == 0 || static_cast<std::int64_t>(i) + 1 == number) acts_[i] = act;
  }
  // A change is sent at once.
  for (Sender& sender : senders_) sender.next.reset();
}

void EmulatedSafetyInputs::tick(Instant now, std::vector<CanFrame>& out) {
  for (Sender& sender : senders_) {
    if (sender.next && now < *sender.next) continue;
    sender.next = now + sender.period;
    if (!any(sender.id, Act::silence)) out.push_back(frame(sender.id));
  }
}

CanFrame EmulatedSafetyInputs::frame(std::uint32_t id) const {
  CanFrame frame;
  frame.id = id;
  for (std::size_t i = 0; i < inputs_.size(); ++i) {
    if (!inputs_[i] || inputs_[i]->id != id) continue;
    const CanInputWiring& input = *inputs_[i];
    const auto not_clear = static_cast<std::uint8_t>(~input.clear & input.mask);
    frame.size = input.length;
    frame.data.at(input.byte) |=
        acts_[i] == Act::demand ? input.stop.value_or(not_clear) : input.clear;
  }
  if (any(id, Act::nonsense)) {
    frame.size = static_cast<std::uint8_t>(frame.size == 1 ? 2 : frame.size - 1);
  }
  return frame;
}

bool EmulatedSafetyInputs::any(std::uint32_t id, Act act) const {
  for (std::size_t i = 0; i < inputs_.size(); ++i) {
    if (inputs_[i] && inputs_[i]->id == id && acts_[i] == act) return true;
  }
  return false;
}

}  // namespace tether
