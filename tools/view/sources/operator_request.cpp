#include "tools/view/sources/operator_request.hpp"

#include <array>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/base/errors.hpp"
#include "tools/base/json.hpp"

namespace tether {

std::int32_t parse_operator_request(std::string_view json) {
  using Request = drive_request_t;
  static constexpr std::array<std::pair<const char*, std::int32_t>, 6> kNames{{
      {"ARM", Request::ARM},
      {"DISARM", Request::DISARM},
      {"ESTOP", Request::ESTOP},
      {"ESTOP_RELEASE", Request::ESTOP_RELEASE},
      {"RESET", Request::RESET},
      {"ALIVE", Request::ALIVE},
  }};
  const auto message = try_parse_json(json);
  if (message.is_object() && message.contains("request")) {
    const auto& wanted = message["request"];
    for (const auto& [name, number] : kNames) {
      if (wanted == name || wanted == number) return number;
    }
  }
  throw UsageError(
      "a request of the drivetrain has to be {\"request\": R} with R one of \"ARM\", \"DISARM\", "
      "\"ESTOP\", \"ESTOP_RELEASE\", \"RESET\", \"ALIVE\"");
}

}  // namespace tether
