#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <sstream>
#include <string>
#include <string_view>

namespace tether::test {

/// No LaTeX here: a whole picture, whose braces are in pairs, and whose texts have no letter that
/// TeX takes for a command, nor a Greek one.
inline void expect_tex(const std::string& tex) {
  EXPECT_TRUE(tex.starts_with("\\begin{tikzpicture}[gnuplot]")) << tex.substr(0, 80);
  EXPECT_NE(tex.find("\\end{tikzpicture}"), std::string::npos) << "cut off";
  EXPECT_EQ(std::count(tex.begin(), tex.end(), '{'), std::count(tex.begin(), tex.end(), '}'));
  std::istringstream lines(tex);
  for (std::string line; std::getline(lines, line);) {
    if (!line.starts_with("\\node[gp node")) continue;
    const std::string text = line.substr(line.find("at ("));
    for (std::size_t i = 1; i < text.size(); ++i) {
      const bool is_special = std::string_view("%&#_").find(text[i]) != std::string_view::npos;
      EXPECT_FALSE(is_special && text[i - 1] != '\\') << line;
    }
    for (const char* letter : {"ε", "δ", "τ", "×"}) {
      EXPECT_EQ(text.find(letter), std::string::npos) << line;
    }
  }
}

}  // namespace tether::test
