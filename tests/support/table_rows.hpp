#pragma once

#include <gmock/gmock.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <vector>

#include "tests/support/source_dir.hpp"

namespace tether::test {

template <class Row>
std::vector<std::string> names_of(const std::vector<Row>& table) {
  std::vector<std::string> names;
  for (const Row& row : table) names.push_back(row.name);
  return names;
}

/// The NAMEs of all functions `RowType NAME_suffix() {` in the sources of one of our folders.
inline std::vector<std::string> rows_defined_in(const std::string& folder,
                                                const std::string& row_type,
                                                std::string_view suffix) {
  std::vector<std::string> names;
  const auto path = std::filesystem::path(in_source("")) / folder;
  for (const auto& entry : std::filesystem::directory_iterator(path)) {
    if (entry.path().extension() != ".cpp") continue;
    std::ifstream file(entry.path());
    for (std::string line; std::getline(file, line);) {
      if (!line.starts_with(row_type + " ") || line.find(") {") == std::string::npos) continue;
      const std::string function =
          line.substr(row_type.size() + 1, line.find('(') - row_type.size() - 1);
      if (function.ends_with(suffix)) {
        names.push_back(function.substr(0, function.size() - suffix.size()));
      }
    }
  }
  return names;
}

/// Table of rows that functions in the folder's sources return: none was forgotten, each has a
/// name, that of its function, and no two have the same.
template <class Row>
void expect_has_all_rows(const std::vector<Row>& table, const std::string& folder,
                         const std::string& row_type, std::string_view suffix) {
  const auto names = names_of(table);
  EXPECT_THAT(names, ::testing::Each(::testing::Not(::testing::IsEmpty())));
  EXPECT_THAT(names,
              ::testing::UnorderedElementsAreArray(rows_defined_in(folder, row_type, suffix)))
      << "the table against the functions in " << folder;
}

}  // namespace tether::test
