#include "can_bridge/profiles/profiles.hpp"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <type_traits>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/input_file.hpp"
#include "common/base/toml_reader.hpp"

namespace tether {
namespace {

struct Row {
  std::string profile;
  std::vector<std::string> sections;
  DrivetrainConfig (*read)(const DrivetrainFile&);
};

template <ProfileConfig... Configs>
std::vector<Row> rows_of(std::type_identity<std::variant<Configs...>>) {
  return {{Configs::kProfile,
           {Configs::kSections.begin(), Configs::kSections.end()},
           [](const DrivetrainFile& file) -> DrivetrainConfig { return Configs::read(file); }}...};
}

const std::vector<Row>& rows() {
  static const std::vector<Row> all = rows_of(std::type_identity<DrivetrainConfig>{});
  return all;
}

/// Keys and sections that files of all profiles have.
const std::vector<std::string>& common_keys() {
  static const std::vector<std::string> keys{"name", "profile", "safety_input"};
  return keys;
}

/// The keys of all profiles' files, each once. Each profile's own keys keep their order.
std::vector<std::string> all_keys() {
  std::vector<std::string> keys = common_keys();
  for (const Row& row : rows()) {
    auto next = keys.begin() + static_cast<std::ptrdiff_t>(common_keys().size());
    for (const std::string& section : row.sections) {
      const auto found = std::find(keys.begin(), keys.end(), section);
      next = (found != keys.end() ? found : keys.insert(next, section)) + 1;
    }
  }
  return keys;
}

/// "\"a\", \"b\" or \"c\"".
std::string all_profiles() {
  std::string text;
  for (const Row& row : rows()) {
    if (!text.empty()) text += &row == &rows().back() ? " or " : ", ";
    text += fmt::format("\"{}\"", row.profile);
  }
  return text;
}

const Row& row_of(const TomlReader& top) {
  const toml::node& node = top.require("profile", all_profiles());
  const auto found = std::ranges::find(rows(), node.value_or(std::string{}), &Row::profile);
  if (found == rows().end()) top.refuse("profile", node, all_profiles());
  return *found;
}

void refuse_sections_of_others(const TomlReader& top, const Row& own) {
  for (const std::string& section : all_keys()) {
    if (std::ranges::find(common_keys(), section) != common_keys().end()) continue;
    const toml::node* const node = top.find(section);
    if (node == nullptr || std::ranges::find(own.sections, section) != own.sections.end()) continue;
    top.refuse_at(node->source().begin.line,
                  fmt::format("[{}] has no effect with profile = \"{}\"", section, own.profile));
  }
}

DrivetrainConfig read(const toml::table& table, const std::string& file) {
  const TomlReader top(table, file, "", all_keys());
  top.require("name", "a text in quotes (for people)");
  std::string name;
  top.text("name", name, "for people");
  const Row& row = row_of(top);
  refuse_sections_of_others(top, row);
  const DrivetrainFile sections(top);
  DrivetrainConfig config = row.read(sections);
  std::visit(
      [&](DrivetrainCommon& common) {
        common.name = std::move(name);
        common.safety_inputs = read_safety_inputs(sections);
      },
      config);
  return config;
}

}  // namespace

DrivetrainConfig parse_drivetrain(const std::string& toml, const std::string& name) {
  return read(parse_toml(toml, name), name);
}

DrivetrainConfig load_drivetrain(const std::string& file) {
  return parse_drivetrain(read_input(file, "the drivetrain file", kMostTomlBytes), file);
}

}  // namespace tether
