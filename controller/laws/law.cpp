#include "controller/laws/law.hpp"

#include <cassert>
#include <iterator>

#include "common/path/make_path.hpp"

namespace tether {

std::unique_ptr<Law> make_law(const Scenario& scenario) {
#define TETHER_MAKER(name, sends) make_##name##_law,
  constexpr std::unique_ptr<Law> (*kMakers[])(const LawContext&) = {
      TETHER_CONTROL_LAWS(TETHER_MAKER)};
#undef TETHER_MAKER
  const auto index = static_cast<std::size_t>(scenario.controller.law);
  assert(index < std::size(kMakers));
  return kMakers[index]({scenario, make_path(scenario.path)});
}

}  // namespace tether
