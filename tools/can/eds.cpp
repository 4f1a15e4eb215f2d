#include "tools/can/eds.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <sstream>
#include <string_view>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"

namespace tether {
namespace {

constexpr int kMostSubindex = 0xFE;
constexpr std::int64_t kMostNode = 127;

std::string lower(std::string_view text) {
  std::string all(text);
  std::ranges::transform(all, all.begin(), [](unsigned char c) { return std::tolower(c); });
  return all;
}

/// "0x1F", "31" or, with a zero in front, octal; with a sign.
std::optional<std::int64_t> number_in(std::string_view text) {
  text = trimmed(text);
  const bool negative = text.starts_with('-');
  if (negative || text.starts_with('+')) text.remove_prefix(1);
  int base = 10;
  if (text.starts_with("0x") || text.starts_with("0X")) {
    base = 16;
    text.remove_prefix(2);
  } else if (text.size() > 1 && text.starts_with('0')) {
    base = 8;
    text.remove_prefix(1);
  }
  std::uint32_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, base);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return negative ? -std::int64_t{value} : std::int64_t{value};
}

/// Keys in lower case; what they are set to, and where.
struct Section {
  struct Value {
    std::string text;
    int line = 0;
  };
  int line = 0;
  std::map<std::string, Value> values{};
};

class Reader {
 public:
  explicit Reader(const std::string& file) : file_(file) {}

  EdsFile read(const std::string& text) {
    split(text);
    EdsFile eds;
    if (!sections_.contains("deviceinfo")) {
      throw UsageError(fmt::format(
          "{}: no section [DeviceInfo]: must be an EDS or a DCF, whose form CiA 306 describes",
          file_));
    }
    const Section& info = sections_.at("deviceinfo");
    eds.vendor = text_of(info, "vendorname");
    eds.product = text_of(info, "productname");
    for (const char* const name : {"devicecomissioning", "devicecommissioning"}) {
      if (const auto found = sections_.find(name); found != sections_.end()) {
        eds.node = number(found->second, "nodeid");
        if (eds.node && (*eds.node < 1 || *eds.node > kMostNode)) {
          refuse(found->second.values.at("nodeid").line,
                 fmt::format("nodeid = {} is not allowed: must be 1 to {}", *eds.node, kMostNode));
        }
      }
    }
    for (const auto& [name, section] : sections_) take(name, section, eds);
    return eds;
  }

 private:
  [[noreturn]] void refuse(int line, const std::string& what) const {
    throw UsageError(fmt::format("{}:{}: {}", file_, line, what));
  }

  void split(const std::string& text) {
    std::istringstream in(text);
    Section* section = nullptr;
    int number = 0;
    for (std::string raw; std::getline(in, raw);) {
      ++number;
      std::string_view line = trimmed(raw);
      if (number == 1 && line.starts_with("\xEF\xBB\xBF")) line.remove_prefix(3);
      if (line.empty() || line.starts_with(';') || line.starts_with('#')) continue;
      if (line.starts_with('[') && line.ends_with(']')) {
        section = &sections_[lower(trimmed(line.substr(1, line.size() - 2)))];
        section->line = number;
        continue;
      }
      const auto equals = line.find('=');
      if (equals == std::string_view::npos || section == nullptr) {
        refuse(number, fmt::format("\"{}\" is not allowed: must be [SECTION], then KEY=VALUE, or a "
                                   "comment that begins with ;",
                                   printable(line, kLongestValueShown)));
      }
      const std::string_view key = trimmed(line.substr(0, equals));
      const auto [entry, is_new] = section->values.try_emplace(
          lower(key), Section::Value{std::string(trimmed(line.substr(equals + 1))), number});
      if (!is_new) {
        refuse(number, fmt::format("{} stands in line {} of the same section already",
                                   printable(key, kLongestValueShown), entry->second.line));
      }
    }
  }

  static std::string text_of(const Section& section, const char* key) {
    const auto found = section.values.find(key);
    return found == section.values.end() ? "" : found->second.text;
  }

  /// Nothing if it is not there, or empty.
  std::optional<std::int64_t> number(const Section& section, const char* key) const {
    const auto found = section.values.find(key);
    if (found == section.values.end() || found->second.text.empty()) return std::nullopt;
    const auto value = number_in(found->second.text);
    if (value) return value;
    refuse(found->second.line, fmt::format("{} = \"{}\" is not allowed: must be a whole number",
                                           key, printable(found->second.text, kLongestValueShown)));
  }

  /// A value of an object, which may be a text, a real number or a formula with $NODEID.
  static std::optional<std::int64_t> value(const Section& section, const char* key) {
    return number_in(text_of(section, key));
  }

  /// [1018] is object 0x1018, [1018sub1] its subindex 1.
  void take(const std::string& name, const Section& section, EdsFile& eds) const {
    constexpr std::size_t kDigits = 4;
    const auto hexadecimal = [](std::string_view digits) -> std::optional<int> {
      int value = 0;
      const auto [end, error] =
          std::from_chars(digits.data(), digits.data() + digits.size(), value, 16);
      if (error != std::errc{} || end != digits.data() + digits.size()) return std::nullopt;
      return value;
    };
    const auto index = hexadecimal(std::string_view(name).substr(0, kDigits));
    if (!index || *index < 0x1000) return;
    const std::string_view rest = std::string_view(name).substr(std::min(kDigits, name.size()));
    std::optional<int> sub = 0;
    if (!rest.empty()) {
      if (!rest.starts_with("sub")) return;
      sub = hexadecimal(rest.substr(3));
      if (!sub || *sub < 0 || *sub > kMostSubindex) return;
    }
    EdsFile::Object object = object_of(section, static_cast<std::uint16_t>(*index), *sub);
    const std::int64_t copies = rest.empty() ? number(section, "compactsubobj").value_or(0) : 0;
    if (copies > 0) {  // all the same, without sections of their own
      if (copies > kMostSubindex) {
        refuse(section.values.at("compactsubobj").line, "CompactSubObj must be at most 0xFE");
      }
      for (int i = 1; i <= copies; ++i) {
        object.ref.sub = static_cast<std::uint8_t>(i);
        eds.objects.emplace(std::pair{object.ref.index, i}, object);
      }
      return;
    }
    if (number(section, "objecttype").value_or(kVariable) != kVariable) return;
    eds.objects.insert_or_assign({object.ref.index, *sub}, std::move(object));
  }

  EdsFile::Object object_of(const Section& section, std::uint16_t index, int sub) const {
    EdsFile::Object object;
    object.ref = {index, static_cast<std::uint8_t>(sub), 0, false};
    switch (number(section, "datatype").value_or(0)) {
      case 2:
      case 3:
        object.ref.is_signed = true;
        object.ref.bytes = static_cast<std::uint8_t>(*number(section, "datatype") - 1);
        break;
      case 4:
        object.ref.is_signed = true;
        object.ref.bytes = 4;
        break;
      case 5:
      case 6:
        object.ref.bytes = static_cast<std::uint8_t>(*number(section, "datatype") - 4);
        break;
      case 7:
        object.ref.bytes = 4;
        break;
      default:
        break;
    }
    object.name = text_of(section, "parametername");
    const std::string access = lower(text_of(section, "accesstype"));
    object.writable = access != "ro" && access != "const";
    object.mappable = number(section, "pdomapping").value_or(0) != 0;
    object.value = value(section, "parametervalue");
    object.default_value = value(section, "defaultvalue");
    return object;
  }

  static constexpr std::int64_t kVariable = 7;
  const std::string& file_;
  std::map<std::string, Section> sections_;
};

}  // namespace

const EdsFile::Object* EdsFile::find(std::uint16_t index, int sub) const {
  const auto found = objects.find({index, sub});
  return found == objects.end() ? nullptr : &found->second;
}

EdsFile read_eds(const std::string& text, const std::string& file) {
  return Reader(file).read(text);
}

}  // namespace tether
