#include <fmt/format.h>
#include <gmock/gmock.h>

#include <string>

#include "common/program/cli.hpp"
#include "tests/common/program/steering_program.hpp"
#include "tests/support/folder.hpp"
#include "tests/support/source_dir.hpp"

// Readers of our manual pages and completions: groff and zsh, which only `setup.sh tests` installs.
namespace tether {
namespace {

using test::output_of;
using test::written;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using Program = test::SteeringProgram;

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

}  // namespace
}  // namespace tether
