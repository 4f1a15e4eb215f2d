#include "common/lcm/open_bus.hpp"

#include <utility>

#include "common/lcm/lcm_bus.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/lcm/udpm_bus.hpp"

namespace tether {

std::unique_ptr<Bus> open_bus(const std::string& url, EventLoop& loop, Bus::Filter filter) {
  if (multicast_group(checked_lcm_url(url)).empty()) return std::make_unique<LcmBus>(url, loop);
  return std::make_unique<UdpmBus>(url, loop, std::move(filter));
}

}  // namespace tether
