#include "tools/margin/verification_text.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

namespace tether {
namespace {

bool is_delay(const VerifiedCritical& row) {
  return row.quantity == VerifiedCritical::Quantity::delay;
}

std::string number(const VerifiedCritical& row, double value) {
  return is_delay(row) ? fmt::format("{:.0f} ms", 1e3 * value) : fmt::format("{:.3f}", value);
}

std::string simulated(const VerifiedCritical& row, const std::optional<SimulatedCritical>& s) {
  if (!s) return "-";
  const double unit = is_delay(row) ? 1e3 : 1.0;
  return fmt::format("{} ± {:.{}f} ({:+.1f} %)", number(row, s->value),
                     0.5 * unit * (s->high - s->low), is_delay(row) ? 1 : 3, 100.0 * row.off(s));
}

nlohmann::ordered_json in_json(const std::optional<SimulatedCritical>& s) {
  if (!s) return nullptr;
  return {{"value", s->value}, {"low", s->low}, {"high", s->high}};
}

constexpr const char* kRow = "{:<81} {:<8} {:>9}  {:<24} {:<24} {}\n";

}  // namespace

std::string verification_head() {
  return fmt::format(fmt::runtime(kRow), "", "critical", "predicted", "linear loop", "whole loop",
                     "");
}

std::string verification_row(const std::string& arm, const VerifiedCritical& row) {
  return fmt::format(fmt::runtime(kRow), arm, is_delay(row) ? "delay" : "PRR",
                     row.predicted ? number(row, *row.predicted) : "-", simulated(row, row.linear),
                     simulated(row, row.full), row.holds() ? row.why : "misses its bar");
}

nlohmann::ordered_json verification_json(const std::string& arm, const VerifiedCritical& row) {
  nlohmann::ordered_json json;
  json["arm"] = arm;
  json["critical"] = is_delay(row) ? "delay_s" : "prr";
  json["predicted"] = nullptr;
  if (row.predicted) json["predicted"] = *row.predicted;
  json["linear"] = in_json(row.linear);
  json["full"] = in_json(row.full);
  json["why"] = row.why;
  json["holds"] = row.holds();
  return json;
}

}  // namespace tether
