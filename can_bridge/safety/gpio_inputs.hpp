#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "can_bridge/drivetrain/safety_input.hpp"
#include "can_bridge/safety/safety_inputs.hpp"
#include "common/node/event_loop.hpp"

namespace tether {

/// One line of a GPIO chip, as an input.
class GpioLine {
 public:
  virtual ~GpioLine() = default;

  /// Readable after an edge.
  virtual int fd() const = 0;
  /// Takes the edges since the last call. Whether one of them led away from clear, or they could
  /// not be read.
  virtual bool left_clear() = 0;
  /// Whether it is clear now; nullopt if it cannot be read.
  virtual std::optional<bool> clear() = 0;

 protected:
  GpioLine() = default;
  GpioLine(const GpioLine&) = delete;
  GpioLine& operator=(const GpioLine&) = delete;
};

using GpioOpener = std::function<std::unique_ptr<GpioLine>(const SafetyInputConfig::Gpio&)>;

/// By libgpiod, for the Linux GPIO character device. Pulls the line towards stop where the chip can
/// do that; where not, an open wire needs a resistor. Throws std::runtime_error that names chip,
/// line and cause.
std::unique_ptr<GpioLine> open_gpiod_line(const SafetyInputConfig::Gpio& gpio);

/// The translator between GPIO lines and SafetyInputs: edges at once, and the level in every cycle,
/// so that a lost edge hides nothing for longer. Only in real time (slow motion included): virtual
/// time has no wires.
class GpioInputs {
 public:
  /// Opens the lines of kind "gpio" in `configs`, which are those of `inputs`. Throws UsageError if
  /// there are some and `loop` is in virtual time. loop and inputs must outlive it.
  GpioInputs(const std::vector<SafetyInputConfig>& configs, EventLoop& loop, SafetyInputs& inputs,
             const GpioOpener& open = open_gpiod_line);
  ~GpioInputs();
  GpioInputs(const GpioInputs&) = delete;
  GpioInputs& operator=(const GpioInputs&) = delete;

  /// Once per control cycle.
  void read();

 private:
  struct Line {
    std::size_t input;
    std::unique_ptr<GpioLine> line;
  };
  void on_edge(Line& line);

  EventLoop& loop_;
  SafetyInputs& inputs_;
  std::vector<Line> lines_;
};

}  // namespace tether
