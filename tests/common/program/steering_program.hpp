#pragma once

#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <fstream>
#include <string>

#include "common/program/cli.hpp"
#include "tests/support/folder.hpp"

namespace tether::test {

/// A program with a command of each kind.
struct SteeringProgram {
  CLI::App app{"Steers. \"Well\" - isn't it?", "steer"};
  std::string file, risk, secret;
  int count = 3;

  SteeringProgram() {
    CLI::App* const drive = app.add_subcommand("drive", ".dots and back\\slashes");
    drive->add_option("file", file, "where to")->required();
    drive->add_option("--risk", risk, "which")->check(CLI::IsMember({"low", "high"}));
    drive->add_option("--secret", secret, "not for the public")->group("");
    CLI::App* const log = app.add_subcommand("log", "Look back");
    log->add_subcommand("info", "in short")
        ->add_option("--count", count, "lines")
        ->capture_default_str()
        ->envname("STEER_COUNT");
    log->add_subcommand("csv", "in full");
    add_examples(*drive, {"steer drive home", "steer drive away --risk high"});
  }
};

/// Output of a shell command, errors too; it ends within seconds.
inline std::string output_of(const std::string& command) {
  std::string all;
  FILE* const pipe = popen((command + " 2>&1").c_str(), "r");
  EXPECT_NE(pipe, nullptr) << command;
  for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe)) all += static_cast<char>(c);
  EXPECT_EQ(pclose(pipe), 0) << command << ": " << all;
  return all;
}

/// Writes the text into a file of this name, and says where.
inline std::string written(const test::Folder& folder, const std::string& name,
                           const std::string& text) {
  const auto path = folder.path / name;
  std::ofstream(path) << text;
  return path.string();
}

}  // namespace tether::test
