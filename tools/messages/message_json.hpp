#pragma once

#include <string>
#include <string_view>

#include "tools/messages/message_printer.hpp"

namespace tether {

// Messages as JSON, one object each: {"utime":50000,"seq":1,"x_m":0.25,…}. Fields keep their names
// and the order of the .lcm file. message_schema.hpp describes the objects.
//
// Integers are written with all digits; a reader whose numbers are doubles (JavaScript) rounds
// those beyond 2^53, which only `session` and `instance` exceed. Doubles are as short as they can
// be without losing a bit. NaN and infinities, which JSON does not know, are null. Text that is not
// UTF-8 has U+FFFD where it is wrong.

/// JSON of a message that was decoded (message.decoded()).
std::string message_json(const MessageContent& message);

/// The same, to the end of `out`.
void append_message_json(std::string& out, const MessageContent& message);

/// One value, or a string with its quotes, to the end of `out`.
void append_json_value(std::string& out, const FieldValue& value);
void append_json_string(std::string& out, std::string_view text);
void append_json_number(std::string& out, double x);

}  // namespace tether
