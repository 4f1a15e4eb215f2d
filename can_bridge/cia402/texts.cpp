#include "can_bridge/cia402/texts.hpp"

#include <fmt/format.h>

#include <array>

namespace tether::cia402 {
namespace {

struct ErrorMeaning {
  std::uint32_t mask, code;
  const char* meaning;
};

// First match wins: codes before their classes.
constexpr std::array<ErrorMeaning, 24> kErrors{{
    {0xFFFF, 0x0000, "no error"},
    {0xFFFF, 0x2310, "continuous over-current: wheel blocked, or load too heavy"},
    {0xFFFF, 0x2320, "short circuit or earth leakage"},
    {0xFFFF, 0x3210, "DC link over-voltage: battery full while braking?"},
    {0xFFFF, 0x3220, "DC link under-voltage: battery, contactor, fuse"},
    {0xFFFF, 0x4210, "device too hot"},
    {0xFFFF, 0x4310, "drive too hot"},
    {0xFFFF, 0x7121, "motor blocked"},
    {0xFFFF, 0x7305, "incremental encoder fault: encoder plug"},
    {0xFFFF, 0x8110, "CAN overrun: messages lost"},
    {0xFFFF, 0x8120, "CAN error-passive: wiring, termination, bit rate"},
    {0xFFFF, 0x8130, "heartbeat of the bridge lost"},
    {0xFFFF, 0x8140, "recovered from bus-off: wiring, termination"},
    {0xFFFF, 0x8210, "PDO of wrong length"},
    {0xFFFF, 0x8250, "setpoints stopped coming"},
    {0xFFFF, 0x8611, "following error: wheel blocked, or load too heavy"},
    {0xF000, 0x2000, "current"},
    {0xF000, 0x3000, "voltage"},
    {0xF000, 0x4000, "temperature"},
    {0xF000, 0x5000, "device hardware"},
    {0xF000, 0x6000, "device software"},
    {0xF000, 0x7000, "motor, encoder or other module"},
    {0xF000, 0x8000, "monitoring"},
    {0xF000, 0x9000, "external error"},
}};

}  // namespace

std::string axis_name(const Cia402Config& config, std::size_t axis) {
  return fmt::format("{} drive (node {})", axis == 0 ? "left" : "right", config.axes[axis].node);
}

std::string node_name(const Cia402Config& config, std::uint8_t node) {
  const bool left = config.axes[0].node == node, right = config.axes[1].node == node;
  if (left != right) return axis_name(config, left ? 0 : 1);
  return fmt::format("drive (node {})", node);
}

std::string pdo_name(const PdoConfig& pdo) {
  return fmt::format("{}PDO{}", pdo.transmit ? "T" : "R", pdo.number);
}

std::string object_text(const ObjectRef& object, const std::string& meaning) {
  const std::string name = fmt::format("0x{:04X}:{:X}", object.index, object.sub);
  return meaning.empty() ? name : fmt::format("{} ({})", name, meaning);
}

std::string error_text(std::uint32_t code) {
  for (const ErrorMeaning& e : kErrors) {
    if ((code & e.mask) == e.code) return fmt::format("0x{:04X} ({})", code, e.meaning);
  }
  return fmt::format("0x{:04X} (vendor's own, see the drive's manual)", code);
}

}  // namespace tether::cia402
