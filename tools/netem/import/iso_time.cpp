#include "tools/netem/import/iso_time.hpp"

#include <chrono>
#include <string>

#include "common/base/text.hpp"

namespace tether {
namespace {

constexpr std::string_view kForm = "0000-00-00T00:00:00";  // a digit for each 0

bool has_form(std::string_view text, std::string_view form) {
  if (text.size() != form.size()) return false;
  for (std::size_t i = 0; i < form.size(); ++i) {
    const bool is_digit = text[i] >= '0' && text[i] <= '9';
    const bool is_blank = form[i] == 'T' && text[i] == ' ';
    if (form[i] == '0' ? !is_digit : text[i] != form[i] && !is_blank) return false;
  }
  return true;
}

/// Ahead of UTC.
std::optional<int> zone_s(std::string_view zone) {
  if (zone.empty() || zone == "Z") return 0;
  const std::string_view shift = zone.substr(1);
  const bool is_signed = zone.front() == '+' || zone.front() == '-';
  if (!is_signed || !(has_form(shift, "00:00") || has_form(shift, "0000") || has_form(shift, "00")))
    return std::nullopt;
  const int hours = *to_number<int>(shift.substr(0, 2));
  const int minutes = shift.size() > 2 ? *to_number<int>(shift.substr(shift.size() - 2)) : 0;
  return (zone.front() == '-' ? -60 : 60) * (60 * hours + minutes);
}

}  // namespace

std::optional<long double> from_iso_time(std::string_view text) {
  if (!has_form(text.substr(0, kForm.size()), kForm)) return std::nullopt;
  const auto number = [&](std::size_t at, std::size_t digits = 2) {
    return *to_number<unsigned>(text.substr(at, digits));
  };
  const std::chrono::year_month_day date{std::chrono::year(static_cast<int>(number(0, 4))),
                                         std::chrono::month(number(5)),
                                         std::chrono::day(number(8))};
  if (!date.ok() || number(11) > 23 || number(14) > 59 || number(17) > 60) return std::nullopt;
  std::string_view rest = text.substr(kForm.size());
  std::string decimals = "0.";
  if (rest.starts_with('.') || rest.starts_with(',')) {
    const std::string_view digits = rest.substr(1, rest.find_first_not_of("0123456789", 1) - 1);
    if (digits.empty()) return std::nullopt;
    decimals += digits;
    rest.remove_prefix(1 + digits.size());
  }
  const auto shift_s = zone_s(rest);
  if (!shift_s) return std::nullopt;
  const auto days = std::chrono::sys_days(date).time_since_epoch().count();
  return days * 86400.0L + number(11) * 3600 + number(14) * 60 + number(17) - *shift_s +
         *to_number<long double>(decimals);
}

}  // namespace tether
