#include "tools/messages/message_json.hpp"

#include <fmt/format.h>

#include <cassert>
#include <cmath>
#include <iterator>
#include <nlohmann/json.hpp>

#include "tools/base/json.hpp"
namespace tether {
namespace {

template <class Number>
void append_real(std::string& out, Number x) {
  if (std::isfinite(x)) {
    fmt::format_to(std::back_inserter(out), "{}", x);
  } else {
    out += "null";
  }
}

struct JsonFormat {
  std::string& out;

  void operator()(std::int64_t x) const {
    const fmt::format_int digits(x);
    out.append(digits.data(), digits.size());
  }
  void operator()(double x) const { append_real(out, x); }
  void operator()(float x) const { append_real(out, x); }
  void operator()(bool x) const { out += x ? "true" : "false"; }
  void operator()(const std::string& x) const { append_json_string(out, x); }
  template <class T>
  void operator()(const std::vector<T>& list) const {
    out += '[';
    for (std::size_t i = 0; i < list.size(); ++i) {
      if (i > 0) out += ',';
      (*this)(list[i]);
    }
    out += ']';
  }
};

bool is_plain(char c) { return c >= ' ' && c <= '~' && c != '"' && c != '\\'; }

}  // namespace

void append_json_value(std::string& out, const FieldValue& value) {
  std::visit(JsonFormat{out}, value);
}

void append_json_number(std::string& out, double x) { append_real(out, x); }

void append_json_string(std::string& out, std::string_view text) {
  for (const char c : text) {
    if (is_plain(c)) continue;
    out += json_text(nlohmann::json(text));
    return;
  }
  out += '"';
  out += text;
  out += '"';
}

void append_message_json(std::string& out, const MessageContent& message) {
  assert(message.decoded());
  for (std::size_t i = 0; i < message.values.size(); ++i) {
    out += i == 0 ? "{\"" : ",\"";
    out += message.type->field_names[i];
    out += "\":";
    append_json_value(out, message.values[i]);
  }
  out += '}';
}

std::string message_json(const MessageContent& message) {
  std::string out;
  append_message_json(out, message);
  return out;
}

}  // namespace tether
