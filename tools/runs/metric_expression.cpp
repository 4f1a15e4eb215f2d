#include "tools/runs/metric_expression.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <muParser.h>

#include <cmath>
#include <limits>

#include "common/base/errors.hpp"
#include "common/base/nearest_name.hpp"
#include "tools/runs/metric.hpp"

namespace tether {
namespace {

[[noreturn]] void refuse(const std::string& why) {
  throw UsageError(
      fmt::format("one of {}, or an expression over them{}", fmt::join(metric_names(), ", "), why));
}

}  // namespace

struct MetricExpression::Parsed {
  mu::Parser parser;
  std::vector<double> values = std::vector<double>(metrics().size(), 1.0);
  std::vector<std::size_t> used;  ///< places in metrics()
};

MetricExpression::MetricExpression(const std::string& text)
    : parsed_(std::make_unique<Parsed>()), label_(text) {
  if (const auto number = metric_number(text)) {
    parsed_->used = {*number};
    is_error_ = metrics()[*number].is_error;
    is_share_ = metrics()[*number].is_share;
    label_ = metrics()[*number].label;
  }
  try {
    for (std::size_t i = 0; i < metrics().size(); ++i) {
      parsed_->parser.DefineVar(metrics()[i].name, &parsed_->values[i]);
    }
    parsed_->parser.SetExpr(text);
    for (const auto& [name, place] : parsed_->parser.GetUsedVar()) {
      const auto number = metric_number(name);
      if (!number) {
        refuse(fmt::format(": \"{}\" is none (did you mean \"{}\"?)", name,
                           nearest_name(metric_names(), name)));
      }
      if (!metric_number(text)) parsed_->used.push_back(*number);
      is_error_ = is_error_ || metrics()[*number].is_error;
    }
    int results = 0;
    parsed_->parser.Eval(results);
    if (results != 1) refuse(": it has to be one number");
  } catch (const mu::ParserError& error) {
    refuse(": " + error.GetMsg());
  }
  if (parsed_->used.empty()) refuse(": there is none in it");
}

MetricExpression::MetricExpression(MetricExpression&&) noexcept = default;
MetricExpression::~MetricExpression() = default;

double MetricExpression::of(const std::vector<double>& all) const {
  for (const std::size_t number : parsed_->used) {
    if (std::isnan(all[number])) return std::numeric_limits<double>::quiet_NaN();
  }
  parsed_->values = all;  // the same place: the parser has pointers to it
  return parsed_->parser.Eval();
}

}  // namespace tether
