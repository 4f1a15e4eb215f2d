#include <fmt/format.h>
#include <gmock/gmock.h>

#include <string>

#include "common/base/errors.hpp"
#include "common/program/cli.hpp"
#include "tests/common/program/steering_program.hpp"
#include "tests/support/folder.hpp"

namespace tether {
namespace {

using test::output_of;
using test::written;
using ::testing::HasSubstr;
using Program = test::SteeringProgram;

/// Completions of bash after these words, the last of which is incomplete.
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

TEST(Completion, NamesTheShellsThatItServes) {
  const Program program;
  EXPECT_THROW(completion_script(program.app, "fish"), UsageError);
}

}  // namespace
}  // namespace tether
