#include "common/program/manual.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <fstream>
#include <string>

#include "common/base/errors.hpp"
#include "common/program/cli.hpp"
#include "tests/support/folder.hpp"
#include "tests/support/source_dir.hpp"

namespace tether {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

/// A program with a command of each kind.
struct Program {
  CLI::App app{"Steers. \"Well\" - isn't it?", "steer"};
  std::string file, risk, secret;
  int count = 3;

  Program() {
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

/// What a shell command prints, errors too; it ends within seconds.
std::string output_of(const std::string& command) {
  std::string all;
  FILE* const pipe = popen((command + " 2>&1").c_str(), "r");
  EXPECT_NE(pipe, nullptr) << command;
  for (int c = std::fgetc(pipe); c != EOF; c = std::fgetc(pipe)) all += static_cast<char>(c);
  EXPECT_EQ(pclose(pipe), 0) << command << ": " << all;
  return all;
}

/// Writes the text into a file of this name, and says where.
std::string written(const test::Folder& folder, const std::string& name, const std::string& text) {
  const auto path = folder.path / name;
  std::ofstream(path) << text;
  return path.string();
}

/// What bash offers after these words, the last of which is incomplete.
std::string completions(const std::string& words) {
  const Program program;
  const test::Folder folder;
  const std::string script =
      written(folder, "steer",
              completion_script(program.app, "bash") +
                  fmt::format("COMP_WORDS=({0})\nCOMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))\n"
                              "_steer_words\necho -n \"${{COMPREPLY[@]}}\"\n",
                              words));
  return output_of("cd " + folder.path.string() + " && bash --norc " + script);
}

TEST(ManualPage, IsTypesetWithoutAWarning) {
  const Program program;
  const test::Folder folder;
  const std::string page = written(folder, "steer.1", manual_page(program.app));
  EXPECT_EQ(output_of("groff -man -ww -Tascii -z " + page), "");
  const std::string text = output_of("groff -man -Tascii -P-cbou " + page);
  EXPECT_THAT(text, AllOf(HasSubstr("Steers. \"Well\" - isn't it?"), HasSubstr("steer drive"),
                          HasSubstr(".dots and back\\slashes"), HasSubstr("where to (required)"),
                          HasSubstr("[3]"), HasSubstr("STEER_COUNT"), HasSubstr("EXIT STATUS"),
                          HasSubstr("  steer drive home\n"), HasSubstr("away --risk high\n")));
  EXPECT_THAT(text, Not(HasSubstr("secret")));
}

TEST(Completion, OffersCommandsOptionsAndChoices) {
  EXPECT_EQ(completions("steer dr"), "drive");
  EXPECT_EQ(completions("steer log ''"), "--help info csv");
  EXPECT_EQ(completions("steer log info --c"), "--count");
  EXPECT_EQ(completions("steer drive --risk l"), "low");
}

TEST(Completion, LeavesFilesToTheShellWhereNoWordFits) {
  const Program program;
  EXPECT_EQ(completions("steer drive ste"), "");
  EXPECT_THAT(completion_script(program.app, "bash"),
              HasSubstr("complete -o default -F _steer_words steer"));
}

TEST(Completion, HidesWhatHelpHides) { EXPECT_EQ(completions("steer drive --s"), ""); }

/// Types into a new zsh, and a tab; it has to show this within some seconds.
void expect_in_zsh(const std::string& keys, const std::string& wanted) {
  const Program program;
  const test::Folder folder;
  written(folder, "_steer", completion_script(program.app, "zsh"));
  EXPECT_THAT(output_of(fmt::format("{}/tests/common/program/zsh_session.py {} '{}' '{}'",
                                    in_source(""), folder.path.string(), keys, wanted)),
              HasSubstr(wanted));
}

TEST(Completion, ServesZshFromTheFirstTimeOn) {
  expect_in_zsh("steer dri", "drive");
  expect_in_zsh("steer drive du", "dump");  // a file
}

TEST(Completion, NamesTheShellsThatItServes) {
  const Program program;
  EXPECT_THROW(completion_script(program.app, "fish"), UsageError);
}

}  // namespace
}  // namespace tether
