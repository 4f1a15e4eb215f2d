#include "doors/ip/floor_plan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

#include "common/base/errors.hpp"

namespace tether::ip {
namespace {

constexpr Address kNetwork = 10U << 24U | 67U << 16U;
constexpr std::size_t kVehiclesPerBlock = 254;

bool is_host_name(const std::string& name) {
  const auto allowed = [](unsigned char c) {
    return c < 128 && (std::isalnum(c) != 0 || c == '-');
  };
  return !name.empty() && name.size() <= 63 && name.front() != '-' && name.back() != '-' &&
         std::all_of(name.begin(), name.end(), allowed);
}

std::string lower(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

}  // namespace

FloorPlan::FloorPlan(const std::vector<std::string>& vehicles) : names_{kControlName} {
  for (const std::string& name : vehicles) {
    if (!is_host_name(name)) {
      throw UsageError(
          fmt::format("vehicle.name = \"{}\" is not a host name: only letters, digits "
                      "and '-' are allowed for IP traffic",
                      name));
    }
    const auto same = [&](const std::string& other) { return lower(other) == lower(name); };
    if (std::any_of(names_.begin(), names_.end(), same)) {
      throw UsageError(fmt::format("vehicle.name = \"{}\" is the name of another host", name));
    }
    names_.push_back(name);
  }
}

Address FloorPlan::address(std::size_t host) {
  if (host == kControl) return kNetwork | 1U;
  const std::size_t n = host - 1;
  return kNetwork | static_cast<Address>((1 + n / kVehiclesPerBlock) << 8U) |
         static_cast<Address>(1 + n % kVehiclesPerBlock);
}

FloorPlan::Route FloorPlan::route(std::size_t from, Address destination) const {
  if (is_for_all(destination) || destination == (kNetwork | 0xffffU)) return {Next::all, 0};
  for (std::size_t host = 0; host < size(); ++host) {
    if (address(host) == destination && host != from) return {Next::one, host};
  }
  return {};
}

std::string FloorPlan::hosts_file() const {
  std::string text;
  for (std::size_t host = 0; host < size(); ++host) {
    text += fmt::format("{} {}\n", to_text(address(host)), name(host));
  }
  return text;
}

}  // namespace tether::ip
