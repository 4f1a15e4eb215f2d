#include "doors/ip/floor_plan.hpp"
#include "tests/fuzz/fuzz.hpp"

namespace tether::fuzzing {

/// A packet from a TUN device.
void try_input(std::span<const std::uint8_t> input) {
  static const ip::FloorPlan plan({"AGV1", "AGV2"});
  const auto header = ip::read_ip_header(input);
  if (!header) return;
  must(input.size() >= 20 && input.size() <= 65'535, "a packet has a header and an end");
  for (std::size_t from = 0; from < plan.size(); ++from) {
    const auto route = plan.route(from, header->destination);
    if (route.next != ip::FloorPlan::Next::one) continue;
    must(route.host < plan.size() && route.host != from, "packets go to another host");
    must(ip::FloorPlan::address(route.host) == header->destination, "packets go where they should");
  }
}

}  // namespace tether::fuzzing
