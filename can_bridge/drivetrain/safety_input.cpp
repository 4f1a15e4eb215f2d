#include "can_bridge/drivetrain/safety_input.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "can_bridge/drivetrain/file.hpp"

namespace tether {
namespace {

using Input = SafetyInputConfig;

constexpr double kShortestRestart_s = 2.0;

/// One entry, which its `kind` and `function` decide the keys of.
class Reader {
 public:
  explicit Reader(const TomlReader& r) : r_(r) {}

  Input run() {
    Input input;
    input.name = read_name();
    const std::string function =
        choice("function", {"protective_stop", "speed_limit", "estop_status"});
    if (function == "speed_limit") input.function = Input::Function::speed_limit;
    if (function == "estop_status") input.function = Input::Function::estop_status;
    only_for("speed_limit_mps", "function = \"speed_limit\"", function == "speed_limit");
    only_for("restart_after_s", "function = \"protective_stop\"", function == "protective_stop");
    only_for("reaction", "function = \"protective_stop\"", function == "protective_stop");
    if (function == "speed_limit") {
      r_.require("speed_limit_mps", "a number from 0.01 to 10 (rim speed)");
      r_.number("speed_limit_mps", input.speed_limit_mps, 0.01, 10.0, "rim speed");
    }
    read_reaction(input);
    if (choice("kind", {"can", "gpio"}) == "can") {
      input.wiring = read_can();
    } else {
      input.wiring = read_gpio();
    }
    return input;
  }

 private:
  std::string read_name() {
    const std::string allowed = "letters, digits and _ in quotes, which no other input has";
    const toml::node& node = r_.require("name", allowed);
    std::string name = node.value_or(std::string{});
    const auto fits = [](char c) {
      return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
    };
    if (name.empty() || !std::ranges::all_of(name, fits)) r_.refuse("name", node, allowed);
    return name;
  }

  std::string choice(const std::string& key, const std::vector<std::string>& values) {
    std::string allowed;
    for (const std::string& value : values) {
      if (!allowed.empty()) allowed += &value == &values.back() ? " or " : ", ";
      allowed += fmt::format("\"{}\"", value);
    }
    const toml::node& node = r_.require(key, allowed);
    std::string value = node.value_or(std::string{});
    if (std::ranges::find(values, value) == values.end()) r_.refuse(key, node, allowed);
    return value;
  }

  void only_for(const std::string& key, const std::string& what, bool met) {
    if (const toml::node* const node = r_.find(key); node != nullptr && !met) {
      r_.refuse_at(node->source().begin.line, fmt::format("safety_input.{} needs {}", key, what));
    }
  }

  void read_reaction(Input& input) {
    only_for("reaction", "safety_input without restart_after_s, which always ramps",
             !r_.has("restart_after_s"));
    if (r_.has("reaction") && choice("reaction", {"quick_stop", "ramp"}) == "ramp") {
      input.reaction = Input::Reaction::ramp;
    }
    if (!r_.has("restart_after_s")) return;
    double after_s = 0.0;
    r_.number("restart_after_s", after_s, kShortestRestart_s, 60.0,
              "how long it has to be clear before the vehicle goes on by itself");
    input.restart_after_s = after_s;
  }

  Input::Gpio read_gpio() {
    refuse_keys("gpio", {"id", "length", "byte", "mask", "clear", "stop", "timeout_ms"});
    Input::Gpio gpio;
    r_.require("chip", "a text in quotes (\"gpiochip0\")");
    r_.text("chip", gpio.chip, "\"gpiochip0\"");
    r_.require("line", "a whole number from 0 to 1023 (see gpioinfo)");
    r_.integer("line", gpio.line, 0, 1023, "see gpioinfo");
    r_.flag("active_low", gpio.active_low, "true: low is clear, and an open wire is pulled up");
    return gpio;
  }

  Input::Can read_can() {
    refuse_keys("can", {"chip", "line", "active_low"});
    Input::Can can;
    required("id", can.id, 1, 0x7FF, "11-bit identifier");
    required("length", can.length, 1, 8, "bytes of the frame");
    required("byte", can.byte, 0, can.length - 1, "within the frame's length");
    required("mask", can.mask, 1, 255, "bits of the byte");
    required("clear", can.clear, 1, 255, "what the bits are while all is well");
    if ((can.clear & ~can.mask) != 0) {
      r_.refuse("clear", *r_.find("clear"), "within the mask: asserted bits mean clear");
    }
    if (const toml::node* const stop = r_.find("stop")) {
      can.stop = 0;
      r_.integer("stop", *can.stop, 0, 255, "what the bits are when it demands a stop");
      if ((*can.stop & ~can.mask) != 0 || *can.stop == can.clear) {
        r_.refuse("stop", *stop, "within the mask, and another value than clear");
      }
    }
    required("timeout_ms", can.timeout_ms, 20, 1000, "a silence that means stop");
    return can;
  }

  template <class Integer>
  void required(const std::string& key, Integer& out, std::int64_t min, std::int64_t max,
                const std::string& meaning) {
    r_.require(key, fmt::format("a whole number from {} to {} ({})", min, max, meaning));
    r_.integer(key, out, min, max, meaning);
  }

  void refuse_keys(const std::string& kind, const std::vector<std::string>& keys) {
    for (const std::string& key : keys) {
      if (const toml::node* const node = r_.find(key)) {
        r_.refuse_at(node->source().begin.line,
                     fmt::format("safety_input.{} has no effect with kind = \"{}\"", key, kind));
      }
    }
  }

  const TomlReader& r_;
};

}  // namespace

std::vector<SafetyInputConfig> read_safety_inputs(const DrivetrainFile& file) {
  std::vector<SafetyInputConfig> inputs;
  file.each("safety_input",
            {"name", "function", "reaction", "restart_after_s", "speed_limit_mps", "kind", "chip",
             "line", "active_low", "id", "length", "byte", "mask", "clear", "stop", "timeout_ms"},
            [&inputs](const TomlReader& r) {
              inputs.push_back(Reader(r).run());
              const std::string& name = inputs.back().name;
              if (std::ranges::count(inputs, name, &SafetyInputConfig::name) > 1) {
                r.refuse("name", *r.find("name"), "a name that no other input has");
              }
            });
  return inputs;
}

}  // namespace tether
