#include "tools/experiment/sweep/section.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <utility>

#include "common/base/errors.hpp"
#include "tools/runs/metric.hpp"

namespace tether {

Section::Section(const toml::table& table, std::string name, std::string file,
                 const std::set<std::string>& known)
    : table_(table), name_(std::move(name)), file_(std::move(file)) {
  for (const auto& [key, node] : table) {
    if (known.contains(std::string(key.str()))) continue;
    throw UsageError(fmt::format("{}:{}: unknown key \"{}{}\"; allowed: {}", file_,
                                 node.source().begin.line, name_, key.str(),
                                 fmt::join(known, ", ")));
  }
}

std::string Section::text(const std::string& key, const std::string& otherwise) const {
  const toml::node* node = table_.get(key);
  if (node == nullptr) return otherwise;
  if (!node->is_string()) refuse(key, "a text");
  return *node->value<std::string>();
}

double Section::number(const std::string& key, double low, double high, double otherwise) const {
  const toml::node* node = table_.get(key);
  if (node == nullptr) return otherwise;
  const auto value = node->is_number() ? node->value<double>() : std::nullopt;
  if (!value || !(*value >= low && *value <= high)) {
    refuse(key, fmt::format("a number in [{}, {}]", low, high));
  }
  return *value;
}

std::int64_t Section::whole(const std::string& key, std::int64_t low,
                            std::int64_t otherwise) const {
  const toml::node* node = table_.get(key);
  if (node == nullptr) return otherwise;
  const auto* value = node->as_integer();
  if (value == nullptr || value->get() < low || value->get() > kMostWhole) {
    refuse(key, fmt::format("a whole number from {} to {}", low, kMostWhole));
  }
  return value->get();
}

bool Section::boolean(const std::string& key, bool otherwise) const {
  const toml::node* node = table_.get(key);
  if (node == nullptr) return otherwise;
  if (!node->is_boolean()) refuse(key, "true or false");
  return *node->value<bool>();
}

std::string Section::metric(const std::string& key) const {
  std::string name = text(key, "epsilon_m");
  if (!metric_number(name)) refuse(key, fmt::format("one of {}", fmt::join(metric_names(), ", ")));
  return name;
}

std::string Section::metric_expression(const std::string& key) const {
  std::string expression = text(key, "epsilon_m");
  try {
    MetricExpression{expression};
  } catch (const UsageError& refused) {
    refuse(key, refused.what());
  }
  return expression;
}

const toml::table* Section::table(const std::string& key) const {
  const toml::node* node = table_.get(key);
  if (node == nullptr) return nullptr;
  if (!node->is_table()) refuse(key, fmt::format("a table, [{}]", key));
  return node->as_table();
}

void Section::refuse(const std::string& key, const std::string& allowed) const {
  const toml::node* node = table_.get(key);
  const auto line = (node == nullptr ? table_.source() : node->source()).begin.line;
  throw UsageError(fmt::format("{}:{}: {}{} must be {}", file_, line, name_, key, allowed));
}

}  // namespace tether
