#include "can_bridge/cia402/read_back.hpp"

#include <fmt/format.h>

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/cia402/config.hpp"

namespace tether::cia402 {
namespace {

std::string value_text(const ObjectRef& object, std::int64_t value) {
  if (object.bytes < 4 || object.is_signed) return fmt::format("{}", value);
  return fmt::format("0x{:X}", static_cast<std::uint64_t>(value));
}

}  // namespace

std::uint32_t raw(const ObjectRef& object, std::int64_t value) {
  std::uint8_t bytes[4]{};
  canopen::write_integer(bytes, object.bytes, value);
  return static_cast<std::uint32_t>(canopen::read_integer(bytes, 4, false));
}

bool is_as_expected(const SdoStep& step, std::int64_t value) {
  const std::uint32_t difference = raw(step.read_back, value) ^ raw(step.read_back, step.expected);
  return (difference & step.mask) == 0;
}

std::string deviation_text(const SdoStep& step, std::int64_t value) {
  return fmt::format("{} reads {} instead of {}", object_text(step.read_back, step.meaning),
                     value_text(step.read_back, value), value_text(step.read_back, step.expected));
}

ReadBack::ReadBack(const Cia402Config& config, std::uint8_t node)
    : sdo_(node, std::chrono::milliseconds(config.sdo_timeout_ms), config.sdo_retries) {}

void ReadBack::begin(const std::vector<SdoStep>& steps) {
  sdo_.cancel();
  steps_ = steps;
  next_ = 0;
  deviation_.clear();
}

void ReadBack::tick(Instant now, std::vector<CanFrame>& out) {
  take_result();
  if (!deviation_.empty()) return;
  if (!sdo_.busy() && next_ < steps_.size()) sdo_.read(steps_[next_].read_back);
  sdo_.tick(now, out);
  take_result();
}

void ReadBack::take_result() {
  const auto result = sdo_.take_result();
  if (!result) return;
  const SdoStep& step = steps_[next_++];
  const std::string name = object_text(step.read_back, step.meaning);
  switch (result->outcome) {
    case SdoResult::Outcome::done:
      if (!is_as_expected(step, result->value)) deviation_ = deviation_text(step, result->value);
      break;
    case SdoResult::Outcome::aborted:
      deviation_ =
          fmt::format("reading {} aborted: {}", name, canopen::abort_text(result->abort_code));
      break;
    case SdoResult::Outcome::no_answer:
    case SdoResult::Outcome::segmented:
      deviation_ = "no answer to reading " + name;
      break;
  }
}

}  // namespace tether::cia402
