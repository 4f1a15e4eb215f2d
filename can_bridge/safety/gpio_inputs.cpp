#include "can_bridge/safety/gpio_inputs.hpp"

#include <fmt/format.h>

#include "common/base/errors.hpp"

namespace tether {

GpioInputs::GpioInputs(const std::vector<SafetyInputConfig>& configs, EventLoop& loop,
                       SafetyInputs& inputs, const GpioOpener& open)
    : loop_(loop), inputs_(inputs) {
  for (std::size_t i = 0; i < configs.size(); ++i) {
    const auto* const gpio = std::get_if<SafetyInputConfig::Gpio>(&configs[i].wiring);
    if (gpio == nullptr) continue;
    if (loop.rate() == 0.0) {
      throw UsageError(fmt::format(
          "safety_input \"{}\" is a GPIO line, which virtual time has not: use tether live or "
          "tether-can-bridge, or kind = \"can\"",
          configs[i].name));
    }
    lines_.push_back({i, open(*gpio)});
  }
  for (Line& line : lines_) {
    loop_.add_fd(line.line->fd(), [this, &line](Instant) { on_edge(line); });
  }
}

GpioInputs::~GpioInputs() {
  for (const Line& line : lines_) loop_.remove_fd(line.line->fd());
}

void GpioInputs::on_edge(Line& line) {
  if (line.line->left_clear()) inputs_.on_level(line.input, false);
  inputs_.on_level(line.input, line.line->clear());
}

void GpioInputs::read() {
  for (Line& line : lines_) inputs_.on_level(line.input, line.line->clear());
}

}  // namespace tether
