#include "tools/view/sources/playback_request.hpp"

#include <fmt/format.h>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"

namespace tether {

const std::vector<Parameter>& parameters_of(const ViewRequest& request) {
  const auto* const parameters = std::get_if<std::vector<Parameter>>(&request.what);
  if (parameters == nullptr) throw UsageError("nothing can be published here");
  return *parameters;
}

bool switch_of(const Parameter& parameter) {
  const auto* const on = parameter.value ? std::get_if<bool>(&*parameter.value) : nullptr;
  if (on == nullptr) refuse_parameter(parameter, "has to be true or false");
  return *on;
}

double number_of(const Parameter& parameter, double low, double high) {
  const auto* const number = parameter.value ? std::get_if<double>(&*parameter.value) : nullptr;
  if (number == nullptr || !(*number >= low && *number <= high)) {
    refuse_parameter(parameter, fmt::format("has to be a number in [{}, {}]", low, high));
  }
  return *number;
}

void refuse_parameter(const Parameter& parameter, const std::string& why) {
  throw UsageError(fmt::format("{} {}", printable(parameter.name, kLongestNameShown), why));
}

}  // namespace tether
