#include "can_bridge/safety/gpio_inputs.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <stdexcept>
#include <string>

#include "common/base/errors.hpp"

namespace tether {
namespace {

using ::testing::HasSubstr;

/// A chip whose lines a test sets.
struct FakeChip {
  struct Level {
    std::optional<bool> clear = true;
    bool was_left = false;
  };
  std::map<unsigned, Level> lines;

  GpioOpener opener() {
    return [this](const SafetyInputConfig::Gpio& gpio) -> std::unique_ptr<GpioLine> {
      return std::make_unique<Line>(lines[gpio.line], static_cast<int>(gpio.line) + 100);
    };
  }

 private:
  struct Line final : GpioLine {
    Line(Level& l, int number) : level(l), descriptor(number) {}
    int fd() const override { return descriptor; }
    bool left_clear() override { return std::exchange(level.was_left, false); }
    std::optional<bool> clear() override { return level.clear; }
    Level& level;
    int descriptor;
  };
};

/// A loop that only knows which descriptors it watches.
struct Descriptors final : EventLoop {
  double speed = 1.0;
  std::map<int, Task> watched;

  Instant now() const override { return kStart; }
  double rate() const override { return speed; }
  void at(Instant, Priority, Task) override {}
  void every(Instant, Duration, Priority, Task) override {}
  void add_fd(int fd, Task task) override { watched[fd] = std::move(task); }
  void remove_fd(int fd) override { watched.erase(fd); }
  void stop() override {}
  std::uint64_t slips() const override { return 0; }
};

SafetyInputConfig on_line(const std::string& name, unsigned line) {
  SafetyInputConfig config;
  config.name = name;
  config.wiring = SafetyInputConfig::Gpio{"chip", line, false};
  return config;
}

struct GpioInputsTest : ::testing::Test {
  std::vector<SafetyInputConfig> configs{on_line("a", 1), on_line("b", 2)};
  FakeChip chip;
  Descriptors loop;
  SafetyInputs inputs{configs};

  std::string stop() { return inputs.cycle(loop.now()).stop; }
};

TEST_F(GpioInputsTest, LevelsAreReadInEveryCycle) {
  GpioInputs gpio(configs, loop, inputs, chip.opener());
  EXPECT_THAT(stop(), HasSubstr("cannot be read")) << "before the first time";
  gpio.read();
  EXPECT_EQ(stop(), "");
  chip.lines[2].clear = false;
  gpio.read();
  EXPECT_EQ(stop(), "safety input b demands a stop");
  chip.lines[2].clear = true;
  gpio.read();
  EXPECT_EQ(stop(), "");
}

TEST_F(GpioInputsTest, AnEdgeCountsAtOnceAndEvenIfItIsOverAlready) {
  GpioInputs gpio(configs, loop, inputs, chip.opener());
  gpio.read();
  ASSERT_EQ(stop(), "");
  chip.lines[1].was_left = true;
  loop.watched.at(101)(loop.now());
  EXPECT_EQ(stop(), "safety input a demands a stop");
  EXPECT_EQ(stop(), "");
}

TEST_F(GpioInputsTest, AChipThatIsUnpluggedMeansStop) {
  GpioInputs gpio(configs, loop, inputs, chip.opener());
  chip.lines[1].clear.reset();
  gpio.read();
  EXPECT_EQ(stop(), "safety input a: line 1 of chip cannot be read");
}

TEST_F(GpioInputsTest, InputsOnCanAreNotItsBusiness) {
  configs[0].wiring = SafetyInputConfig::Can{.id = 0x3A0, .clear = 1};
  inputs = SafetyInputs(configs);
  GpioInputs gpio(configs, loop, inputs, chip.opener());
  EXPECT_EQ(loop.watched.size(), 1U);
  gpio.read();
  EXPECT_EQ(stop(), "safety input a: no frame 0x3A0 for 100 ms: check its supply and plug");
}

TEST_F(GpioInputsTest, IsRefusedInVirtualTime) {
  loop.speed = 0.0;
  EXPECT_THROW(
      try { GpioInputs(configs, loop, inputs, chip.opener()); } catch (const UsageError& e) {
        EXPECT_THAT(e.what(), HasSubstr("safety_input \"a\" is a GPIO line, which virtual time"));
        throw;
      },
      UsageError);
  EXPECT_NO_THROW(GpioInputs({}, loop, inputs, chip.opener()));
}

TEST_F(GpioInputsTest, WatchesNothingAfterItsEnd) {
  { GpioInputs gpio(configs, loop, inputs, chip.opener()); }
  EXPECT_TRUE(loop.watched.empty());
}

TEST(GpiodLine, AChipThatIsNotThereIsNamed) {
  EXPECT_THROW(
      try {
        open_gpiod_line({"no_such_chip", 17, false});
      } catch (const std::runtime_error& e) {
        EXPECT_THAT(e.what(), HasSubstr("cannot use line 17 of GPIO chip \"no_such_chip\""));
        throw;
      },
      std::runtime_error);
}

}  // namespace
}  // namespace tether
