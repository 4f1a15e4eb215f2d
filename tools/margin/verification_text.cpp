#include "tools/margin/verification_text.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

namespace tether {
namespace {

bool is_delay(const VerifiedCritical& row) {
  return row.quantity == VerifiedCritical::Quantity::delay;
}

bool is_time(const VerifiedCritical& row) {
  return row.quantity == VerifiedCritical::Quantity::excursion;
}

const char* name(const VerifiedCritical& row, const char* prr, const char* delay,
                 const char* excursion) {
  return is_delay(row) ? delay : is_time(row) ? excursion : prr;
}

std::string number(const VerifiedCritical& row, double value) {
  if (is_time(row)) return fmt::format("{:.0f} s", value);
  return is_delay(row) ? fmt::format("{:.0f} ms", 1e3 * value) : fmt::format("{:.3f}", value);
}

std::string simulated(const VerifiedCritical& row, const std::optional<SimulatedCritical>& s) {
  if (!s) return "-";
  const double unit = is_delay(row) ? 1e3 : 1.0;
  if (is_time(row))
    return fmt::format("{} ({:.0f} to {:.0f})", number(row, s->value), s->low, s->high);
  return fmt::format("{} ± {:.{}f} ({:+.1f} %)", number(row, s->value),
                     0.5 * unit * (s->high - s->low), is_delay(row) ? 1 : 3, 100.0 * row.off(s));
}

nlohmann::ordered_json in_json(const std::optional<SimulatedCritical>& s) {
  if (!s) return nullptr;
  return {{"value", s->value}, {"low", s->low}, {"high", s->high}};
}

std::vector<std::string> plain(const Arm& arm) {
  std::vector<std::string> values;
  for (const KeyValue& setting : arm.settings) values.push_back(setting.plain());
  return values;
}

}  // namespace

VerificationTable::VerificationTable(const Experiment& experiment) : keys_(experiment.keys) {
  for (const std::string& key : keys_) widths_.push_back(key.size());
  for (const Arm& arm : experiment.arms) {
    const auto values = plain(arm);
    for (std::size_t i = 0; i < values.size(); ++i) {
      widths_[i] = std::max(widths_[i], values[i].size());
    }
  }
}

std::string VerificationTable::line(const std::vector<std::string>& settings,
                                    const std::vector<std::string>& cells) const {
  std::string text;
  for (std::size_t i = 0; i < settings.size(); ++i) {
    text += fmt::format("{:<{}}  ", settings[i], widths_[i]);
  }
  text += fmt::format("{:<9}  {:>9}  {:<26}  {:<26}  {}", cells[0], cells[1], cells[2], cells[3],
                      cells[4]);
  return text.substr(0, text.find_last_not_of(' ') + 1) + "\n";
}

std::string VerificationTable::head() const {
  return line(keys_, {"critical", "predicted", "linear loop", "whole loop", ""});
}

std::string VerificationTable::row(const Arm& arm, const VerifiedCritical& row) const {
  const std::string misses = row.holds() ? "" : "misses its bar";
  return line(plain(arm), {name(row, "PRR", "delay", "excursion"),
                           row.predicted ? number(row, *row.predicted) : "-",
                           simulated(row, row.linear), simulated(row, row.full),
                           misses + (misses.empty() || row.why.empty() ? "" : "; ") + row.why});
}

nlohmann::ordered_json verification_json(const Arm& arm, const VerifiedCritical& row) {
  nlohmann::ordered_json json;
  json["arm"] = arm.text();
  json["critical"] = name(row, "prr", "delay_s", "excursion_s");
  json["predicted"] = nullptr;
  if (row.predicted) json["predicted"] = *row.predicted;
  json["linear"] = in_json(row.linear);
  json["full"] = in_json(row.full);
  json["why"] = row.why;
  json["holds"] = row.holds();
  return json;
}

}  // namespace tether
