#include "common/program/cli.hpp"

#include <gmock/gmock.h>

#include <CLI/CLI.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "common/base/errors.hpp"

namespace tether {
namespace {

using testing::AllOf;
using testing::HasSubstr;

struct Outcome {
  int exit_code = -1;
  bool body_ran = false;
  std::string out;
  std::string err;
};

Outcome run(std::vector<std::string> arguments, const std::function<int()>& body) {
  arguments.insert(arguments.begin(), "tether-test");
  std::vector<char*> argv;
  for (auto& a : arguments) argv.push_back(a.data());

  CLI::App app("a program for tests", "tether-test");
  add_about(app);
  int number = 0;
  app.add_option("--number", number, "any number");

  Outcome outcome;
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  outcome.exit_code = run_cli(app, static_cast<int>(argv.size()), argv.data(), [&] {
    outcome.body_ran = true;
    return body();
  });
  outcome.out = testing::internal::GetCapturedStdout();
  outcome.err = testing::internal::GetCapturedStderr();
  return outcome;
}

int succeed() { return kExitOk; }

TEST(Cli, ExitsWithWhatTheBodyReturns) {
  EXPECT_EQ(run({}, succeed).exit_code, 0);
  EXPECT_EQ(run({}, [] { return int{kExitFailed}; }).exit_code, 1);
  EXPECT_EQ(run({}, succeed).err, "");
}

TEST(Cli, HelpAndVersionExitWithZeroAndRunNothing) {
  const Outcome help = run({"--help"}, succeed);
  EXPECT_EQ(help.exit_code, 0);
  EXPECT_FALSE(help.body_ran);
  EXPECT_THAT(help.out, AllOf(HasSubstr("a program for tests"), HasSubstr("--number")));

  const Outcome version = run({"--version"}, succeed);
  EXPECT_EQ(version.exit_code, 0);
  EXPECT_FALSE(version.body_ran);
  EXPECT_THAT(version.out, HasSubstr("tether-test 0."));
}

TEST(Cli, ABadCommandLineExitsWithTwoAndRunsNothing) {
  for (const std::string argument : {"--nonsense", "--number=x", "stray"}) {
    const Outcome outcome = run({argument}, succeed);
    EXPECT_EQ(outcome.exit_code, 2) << argument;
    EXPECT_FALSE(outcome.body_ran) << argument;
    EXPECT_NE(outcome.err, "") << argument;
  }
}

TEST(Cli, AUsageErrorExitsWithTwoAfterOneLine) {
  const Outcome outcome = run({}, []() -> int { throw UsageError("no such scenario"); });
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_EQ(outcome.err, "tether-test: error: no such scenario\n");
}

TEST(Cli, AnyOtherExceptionExitsWithOneAfterOneLine) {
  const Outcome outcome = run({}, []() -> int { throw std::runtime_error("no network"); });
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_EQ(outcome.err, "tether-test: error: no network\n");
}

}  // namespace
}  // namespace tether
