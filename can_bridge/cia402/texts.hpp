#pragma once

#include <cstdint>
#include <string>

#include "can_bridge/cia402/config.hpp"

/// How CiA 402 drives, objects and errors are called in texts for technicians.
namespace tether::cia402 {

/// "left drive (node 1)", "right drive (node 2)".
std::string axis_name(const Cia402Config& config, std::size_t axis);

/// Same as axis_name() where the node has one axis, else "drive (node 1)".
std::string node_name(const Cia402Config& config, std::uint8_t node);

/// "TPDO1".
std::string pdo_name(const PdoConfig& pdo);

/// "0x1016:1 (heartbeat consumer)"; without meaning: "0x1016:1".
std::string object_text(const ObjectRef& object, const std::string& meaning = "");

/// "0x8130 (heartbeat of the bridge lost)": error codes of EMCY and 0x603F (CiA 301, table 26;
/// IEC 61800-7-201, error codes).
std::string error_text(std::uint32_t code);

}  // namespace tether::cia402
