#include "tools/messages/message_schema.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tools/base/json.hpp"
namespace tether {
namespace {

using Json = nlohmann::ordered_json;

struct NoteRow {
  enum class Of { message, field, constant } of;
  std::string_view type;
  std::string_view name;
  std::int64_t value;
  std::string_view words;
};

constexpr NoteRow kNotes[] = {
#define TETHER_MESSAGE(type, words) {NoteRow::Of::message, type, "", 0, words},
#define TETHER_FIELD(type, name, words) {NoteRow::Of::field, type, name, 0, words},
#define TETHER_CONSTANT(type, name, value, words) {NoteRow::Of::constant, type, name, value, words},
#include <tether/message_notes.inc>
#undef TETHER_MESSAGE
#undef TETHER_FIELD
#undef TETHER_CONSTANT
};

struct Unit {
  std::string_view ending;
  std::string_view symbol;
};

// A longer ending comes before the shorter one that it ends with.
constexpr Unit kUnits[] = {
    {"utime", "µs"},       {"_m_rad", "m·rad"}, {"_rad2", "rad²"}, {"_m2", "m²"},
    {"_radps", "rad/s"},   {"_mps", "m/s"},     {"_rad", "rad"},   {"_m", "m"},
    {"_bytes", "B"},       {"_ns", "ns"},       {"_us", "µs"},     {"_s", "s"},
    {"_counts", "counts"},
};

// Quantiles and means name the unit before what they are: delay_ms_p99.
constexpr Unit kUnitsWithin[] = {{"_ms", "ms"}};

Json type_of(const FieldValue& empty) {
  struct Kind {
    Json operator()(std::int64_t) const { return {{"type", "integer"}}; }
    Json operator()(double) const { return {{"type", "number"}}; }
    Json operator()(float) const { return {{"type", "number"}}; }
    Json operator()(bool) const { return {{"type", "boolean"}}; }
    Json operator()(const std::string&) const { return {{"type", "string"}}; }
    Json operator()(const std::vector<std::int64_t>&) const { return list((*this)(0L)); }
    Json operator()(const std::vector<float>&) const { return list((*this)(0.0)); }
    Json operator()(const std::vector<double>&) const { return list((*this)(0.0)); }
    Json operator()(const std::vector<std::string>&) const { return list((*this)(std::string())); }
    static Json list(const Json& item) { return {{"type", "array"}, {"items", item}}; }
  };
  return std::visit(Kind{}, empty);
}

Json property(const FieldValue& empty, const FieldNote& note) {
  Json property = type_of(empty);
  std::string words = note.meaning;
  if (!note.unit.empty()) words += fmt::format("{}[{}]", words.empty() ? "" : " ", note.unit);
  if (!words.empty()) property["description"] = words;
  if (!note.unit.empty()) property["unit"] = note.unit;
  for (const ConstantNote& constant : note.constants) {
    Json& choices = property["oneOf"];
    choices.push_back({{"title", constant.name}, {"const", constant.value}});
    if (!constant.meaning.empty()) choices.back()["description"] = constant.meaning;
  }
  return property;
}

std::vector<ConstantNote> constants_of(const MessageType& type) {
  std::vector<ConstantNote> constants;
  for (const NoteRow& row : kNotes) {
    if (row.of != NoteRow::Of::constant || row.type != type.name) continue;
    constants.push_back({std::string(row.name), row.value, std::string(row.words)});
  }
  return constants;
}

}  // namespace

std::string unit_of(std::string_view field_name) {
  for (const Unit& unit : kUnits) {
    if (field_name.ends_with(unit.ending)) return std::string(unit.symbol);
  }
  for (const Unit& unit : kUnitsWithin) {
    const std::size_t at = field_name.find(unit.ending);
    if (at == std::string_view::npos) continue;
    const std::string_view rest = field_name.substr(at + unit.ending.size());
    if (rest.empty() || rest.front() == '_') return std::string(unit.symbol);
  }
  return "";
}

std::string message_note(const MessageType& type) {
  for (const NoteRow& row : kNotes) {
    if (row.of == NoteRow::Of::message && row.type == type.name) return std::string(row.words);
  }
  return "";
}

std::vector<FieldNote> field_notes(const MessageType& type) {
  std::vector<FieldNote> notes;
  for (const std::string& name : type.field_names) {
    FieldNote note{"", unit_of(name), {}};
    const auto* const row = std::ranges::find_if(kNotes, [&](const NoteRow& r) {
      return r.of == NoteRow::Of::field && r.type == type.name && r.name == name;
    });
    if (row != std::end(kNotes)) note.meaning = row->words;
    if (note.meaning.starts_with("one of the constants")) note.constants = constants_of(type);
    notes.push_back(std::move(note));
  }
  return notes;
}

std::string schema_name(const MessageType& type) { return "tether." + type.name; }

std::string json_schema(const MessageType& type) {
  Json schema;
  schema["title"] = schema_name(type);
  schema["description"] = message_note(type);
  schema["type"] = "object";
  const std::vector<FieldNote> notes = field_notes(type);
  for (std::size_t i = 0; i < notes.size(); ++i) {
    schema["properties"][type.field_names[i]] = property(type.empty[i], notes[i]);
  }
  schema["required"] = type.field_names;
  return json_text(schema);
}

}  // namespace tether
