#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "tests/support/source_dir.hpp"
#include "tests/tools/runs/run_files.hpp"
#include "tools/base/replacing_output.hpp"
#include "tools/experiment/sweep/experiment.hpp"

namespace tether::test {

/// An experiment file of its own folder, with the paper's scenario.
class ExperimentFile : public ::testing::Test {
 protected:
  Experiment load(const std::string& text, const std::vector<std::string>& overrides = {}) {
    write_file(file_,
               fmt::format("scenario = \"{}/scenarios/paper.toml\"\n{}", in_source(""), text));
    return load_experiment(file_, overrides);
  }
  std::string why_refused(const std::string& text, const std::vector<std::string>& overrides = {}) {
    try {
      load(text, overrides);
    } catch (const UsageError& error) {
      return error.what();
    }
    return "not refused";
  }

  Folder own_;
  const std::filesystem::path& folder_ = own_.path;
  std::string file_ = (folder_ / "e.toml").string();
};

/// Texts of the arms.
inline std::vector<std::string> texts(const Experiment& experiment) {
  std::vector<std::string> texts;
  for (const Arm& arm : experiment.arms) texts.push_back(arm.text());
  return texts;
}

}  // namespace tether::test
