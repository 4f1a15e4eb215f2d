#include "tools/base/replacing_output.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>

#include "tests/support/folder.hpp"

namespace tether {
namespace {

std::size_t files_in(const std::filesystem::path& folder) {
  return static_cast<std::size_t>(std::distance(std::filesystem::directory_iterator(folder), {}));
}

TEST(ReplacingOutput, TakesThePlaceOfTheFileWhenItIsClosed) {
  const test::Folder folder;
  const auto file = folder.file("x", "old");
  ReplacingOutput out(file);
  out.write("new ");
  out.write("text");
  EXPECT_EQ(test::contents(file), "old");
  out.close();
  EXPECT_EQ(test::contents(file), "new text");
  EXPECT_EQ(files_in(folder.path), 1U);
}

TEST(ReplacingOutput, ThatIsNotClosedLeavesTheFileAsItWas) {
  const test::Folder folder;
  const auto file = folder.file("x", "old");
  { ReplacingOutput(file).write("new"); }
  EXPECT_EQ(test::contents(file), "old");
  EXPECT_EQ(files_in(folder.path), 1U);
}

TEST(ReplacingOutput, NamesTheFileThatCannotBeWritten) {
  EXPECT_THAT([] { ReplacingOutput("/nowhere/x"); },
              ::testing::ThrowsMessage<std::runtime_error>(
                  "cannot write \"/nowhere/x\": No such file or directory"));
  ReplacingOutput full("/dev/full");
  EXPECT_THAT([&] { full.write("x"); }, ::testing::ThrowsMessage<std::runtime_error>(
                                            "cannot write \"/dev/full\": No space left on device"));
}

}  // namespace
}  // namespace tether
