#include "can_bridge/cia402/identifiers.hpp"

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/cia402/startup.hpp"

namespace tether::cia402 {
namespace {

constexpr int kPdos = 4;

}  // namespace

Sender sender_of(std::uint32_t id, const Cia402Config& config, const PdoMap& pdos) {
  using Kind = Sender::Kind;
  if (id == canopen::kNmt) return {Kind::nmt};
  if (id == canopen::kSync) return {Kind::sync};
  if (id == canopen::kHeartbeat + config.master_node) return {Kind::master_heartbeat};
  for (const std::uint8_t node : config.nodes()) {
    if (id == canopen::kSdoRequest + node) return {Kind::sdo_request, node};
    if (id == canopen::kSdoResponse + node) return {Kind::sdo_response, node};
    if (id == canopen::kHeartbeat + node) return {Kind::heartbeat, node};
    if (id == canopen::kEmcy + node) return {Kind::emergency, node};
    for (int number = 1; number <= kPdos; ++number) {
      if (id == canopen::pdo_id(false, number, node)) return {Kind::setpoint, node};
    }
  }
  if (const PdoMap::Pdo* pdo = pdos.tpdo(id)) return {Kind::feedback, pdo->node};
  return {};
}

std::vector<CanFilter> drivetrain_filters(const Cia402Config& config, const PdoMap& pdos) {
  std::vector<CanFilter> filters;
  for (std::uint32_t id = 0; id <= 0x7FF; ++id) {
    if (sender_of(id, config, pdos).kind != Sender::Kind::other) filters.push_back({id, 0x7FF});
  }
  return filters;
}

}  // namespace tether::cia402
