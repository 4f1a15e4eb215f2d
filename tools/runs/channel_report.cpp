#include "tools/runs/channel_report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <tether/plan_t.hpp>
#include <tether/pose_t.hpp>
#include <tether/twist_t.hpp>
#include <utility>
#include <vector>

#include "controller/laws/controller_settings.hpp"
#include "controller/laws/law.hpp"
#include "netem/channel/settings.hpp"
#include "netem/models/kinds.hpp"
#include "sim/sensor/sensor_settings.hpp"

namespace tether {
namespace {

/// A twist, or a plan with all its twists.
double command_bytes(const ControllerSettings& controller) {
  if (!kind_of(controller).sends_plans) return twist_t{}.getEncodedSize();
  constexpr double kTwist = 2 * sizeof(float);
  const double twists =
      std::max(1.0, std::round(controller.horizon_s * 1e3 / controller.plan_step_ms));
  return plan_t{}.getEncodedSize() + kTwist * twists;
}

}  // namespace

LinkTraffic pose_traffic(const Scenario& scenario) {
  return {.interval_s = 1.0 / scenario.get<SensorSettings>().rate_hz,
          .packet_bytes = static_cast<double>(pose_t{}.getEncodedSize())};
}

LinkTraffic command_traffic(const Scenario& scenario, bool in_loop) {
  LinkTraffic traffic{.packet_bytes = command_bytes(scenario.get<ControllerSettings>())};
  if (scenario.get<ControllerSettings>().trigger == ControllerSettings::Trigger::timer) {
    traffic.interval_s = 1.0 / scenario.get<ControllerSettings>().rate_hz;
    return traffic;
  }
  traffic.interval_s = 1.0 / scenario.get<SensorSettings>().rate_hz;
  if (!in_loop) return traffic;
  traffic.periodic = false;
  if (scenario.get<ChannelSettings>().shared_state &&
      kind_of(scenario.get<ChannelSettings>().uplink)
              .moves(scenario.get<ChannelSettings>().uplink) != ChannelModelKind::Moves::never) {
    traffic.selected_because =
        "commands answer the poses that arrive, and the state that both directions share decides "
        "which do";
  }
  return traffic;
}

ChannelTraffic channel_traffic(const Scenario& scenario, bool in_loop) {
  ChannelTraffic traffic{pose_traffic(scenario), command_traffic(scenario, in_loop)};
  const bool poses = scenario.get<SensorSettings>().send == SensorSettings::Send::changed;
  const bool commands =
      scenario.get<ControllerSettings>().send == ControllerSettings::Send::changed;
  // More are sent while much changes, and the channel may be another one then.
  const char* because = "they are sent when something changes";
  if (in_loop && poses) traffic.uplink.selected_because = because;
  if (in_loop && (poses || commands)) traffic.downlink.selected_because = because;
  return traffic;
}

namespace {

constexpr const char* kIndent = "          ";

nlohmann::ordered_json number(double value) {
  if (!std::isfinite(value)) return nullptr;
  return value;
}

std::string text_of(double value) {
  if (std::isnan(value)) return "-";
  if (std::isinf(value)) return value > 0.0 ? "∞" : "-∞";
  return fmt::format("{:.6g}", value);
}

std::string interval_of(const Estimate& e) {
  return fmt::format("{} … {}", text_of(e.low), text_of(e.high));
}

std::string with_unit(const std::string& quantity, const std::string& unit) {
  return unit.empty() ? quantity : fmt::format("{} [{}]", quantity, unit);
}

std::string row_of(const ChannelCheck& c) {
  std::string verdict = to_string(c.verdict);
  if (!c.reason.empty()) verdict += ": " + c.reason;
  return fmt::format("{:<30} {:>11} {:>11}  {:<23} {}", with_unit(c.quantity, c.unit),
                     text_of(c.configured), text_of(c.achieved.value), interval_of(c.achieved),
                     verdict);
}

std::string header() {
  return fmt::format("{:<30} {:>11} {:>11}  {:<23} {}", "quantity", "configured", "achieved",
                     "95 % interval", "verdict");
}

/// "PRR, delay p50, p90, p99": the first word is not said twice in a row.
void append_quantity(std::string& list, const std::string& quantity) {
  const std::string kDelay = "delay ";
  const std::size_t last = list.rfind(kDelay);
  const bool again = quantity.starts_with(kDelay) && last != std::string::npos;
  if (!list.empty()) list += ", ";
  list += again ? quantity.substr(kDelay.size()) : quantity;
}

}  // namespace

nlohmann::ordered_json to_json(const ChannelReport::Direction& link) {
  nlohmann::ordered_json json;
  json["channel_check"] = to_string(overall(link.checks));
  json["check"] = nlohmann::ordered_json::array();
  for (const ChannelCheck& c : link.checks) {
    nlohmann::ordered_json row;
    row["quantity"] = c.quantity;
    row["unit"] = c.unit;
    row["configured"] = number(c.configured);
    row["achieved"] = number(c.achieved.value);
    row["low"] = number(c.achieved.low);
    row["high"] = number(c.achieved.high);
    row["verdict"] = to_string(c.verdict);
    if (!c.reason.empty()) row["reason"] = c.reason;
    json["check"].push_back(std::move(row));
  }
  return json;
}

std::string to_text(const ChannelReport::Direction& link) {
  if (link.packets == 0) return "";
  // Text, and the quantities that it applies to.
  std::vector<std::pair<std::string, std::string>> groups;
  const auto list_of = [&groups](const std::string& what) -> std::string& {
    for (auto& [name, list] : groups) {
      if (name == what) return list;
    }
    return groups.emplace_back(what, "").second;
  };
  std::string rows;
  for (const ChannelCheck& c : link.checks) {
    std::string what;
    switch (c.verdict) {
      case Verdict::outside:
        rows += kIndent + row_of(c) + "\n";
        continue;
      case Verdict::ok:
        what = "channel as configured";
        break;
      case Verdict::too_short:
        what = "too short to say";
        break;
      case Verdict::not_comparable:
        what = fmt::format("not comparable, because {}", c.reason);
        break;
    }
    append_quantity(list_of(what), c.quantity);
  }
  std::string line;
  for (const auto& [what, list] : groups) {
    line += fmt::format("{}{}: {}", line.empty() ? "" : "; ", what, list);
  }
  std::string text = line.empty() ? "" : kIndent + line + "\n";
  if (!rows.empty())
    text += fmt::format("{0}NOT AS CONFIGURED\n{0}{1}\n{2}", kIndent, header(), rows);
  return text;
}

std::string to_table(const ChannelReport::Direction& link) {
  std::string text = header() + "\n";
  for (const ChannelCheck& c : link.checks) text += row_of(c) + "\n";
  return text;
}

}  // namespace tether
