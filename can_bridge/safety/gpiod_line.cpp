#include <fmt/format.h>
#include <gpiod.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <stdexcept>

#include "can_bridge/safety/gpio_inputs.hpp"

namespace tether {
namespace {

class GpiodLine final : public GpioLine {
 public:
  explicit GpiodLine(const SafetyInputConfig::Gpio& gpio)
      : chip_(gpiod_chip_open_lookup(gpio.chip.c_str()), &gpiod_chip_close) {
    if (!chip_) fail(gpio, "is there such a chip (gpiodetect), and may this user open it");
    line_ = gpiod_chip_get_line(chip_.get(), gpio.line);
    if (line_ == nullptr) fail(gpio, "has the chip such a line (gpioinfo)");
    const int flags =
        gpio.active_low ? GPIOD_LINE_REQUEST_FLAG_ACTIVE_LOW | GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_UP
                        : static_cast<int>(GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_DOWN);
    if (gpiod_line_request_both_edges_events_flags(line_, "tether-can-bridge", flags) != 0) {
      fail(gpio, "does another program use it (gpioinfo)");
    }
  }
  /// Closing the chip releases the line.
  int fd() const override { return gpiod_line_event_get_fd(line_); }

  bool left_clear() override {
    std::array<gpiod_line_event, 16> events{};
    const int count = gpiod_line_event_read_multiple(line_, events.data(), events.size());
    bool left = count < 0;
    for (int i = 0; i < count; ++i) {
      left =
          left || events[static_cast<std::size_t>(i)].event_type == GPIOD_LINE_EVENT_FALLING_EDGE;
    }
    return left;
  }

  std::optional<bool> clear() override {
    const int value = gpiod_line_get_value(line_);
    if (value < 0) return std::nullopt;
    return value != 0;
  }

 private:
  [[noreturn]] static void fail(const SafetyInputConfig::Gpio& gpio, const char* question) {
    throw std::runtime_error(fmt::format("cannot use line {} of GPIO chip \"{}\": {}: {}?",
                                         gpio.line, gpio.chip, std::strerror(errno), question));
  }

  std::unique_ptr<gpiod_chip, decltype(&gpiod_chip_close)> chip_;
  gpiod_line* line_ = nullptr;
};

}  // namespace

std::unique_ptr<GpioLine> open_gpiod_line(const SafetyInputConfig::Gpio& gpio) {
  return std::make_unique<GpiodLine>(gpio);
}

}  // namespace tether
