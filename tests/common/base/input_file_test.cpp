#include "common/base/input_file.hpp"

#include <gmock/gmock.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "common/path/waypoints.hpp"
#include "common/scenario/scenario.hpp"

namespace tether {
namespace {

using testing::AllOf;
using testing::EndsWith;
using testing::HasSubstr;

class InputFile : public testing::Test {
 protected:
  InputFile() {
    std::filesystem::create_directories(folder_);
    mkfifo(pipe().c_str(), 0600);
  }
  ~InputFile() override { std::filesystem::remove_all(folder_); }

  std::string pipe() const { return (folder_ / "pipe").string(); }
  std::string file(const std::string& text) const {
    const auto name = folder_ / "file";
    std::ofstream(name, std::ios::binary) << text;
    return name.string();
  }
  static std::string refusal(const std::function<void()>& read) {
    try {
      read();
    } catch (const UsageError& error) {
      return error.what();
    }
    return "read";
  }

 private:
  std::filesystem::path folder_ = std::filesystem::path(testing::TempDir()) /
                                  testing::UnitTest::GetInstance()->current_test_info()->name();
};

TEST_F(InputFile, IsNoDeviceNoPipeAndNoDirectory) {
  for (const std::string& name : {std::string("/dev/zero"), pipe()}) {
    EXPECT_EQ(refusal([&] { read_input(name, "the trace", 100); }),
              "cannot read the trace \"" + name + "\": it is not a regular file");
  }
  EXPECT_THAT(refusal([] { open_input("/", "the trace", 100); }), HasSubstr("\"/\": it is a dir"));
  EXPECT_THAT(refusal([] { open_input("/nowhere", "the trace", 100); }),
              HasSubstr("\"/nowhere\": No such file"));
}

TEST_F(InputFile, ThatIsMissingIsAnsweredWithASimilarName) {
  const std::string is = file("");
  const std::string folder = is.substr(0, is.size() - 4);
  const auto refused = [&](const std::string& name) {
    return refusal([&] { read_input(folder + name, "the trace", 100); });
  };
  EXPECT_EQ(refused("fille"), "cannot read the trace \"" + folder +
                                  "fille\": No such file or directory (did you mean \"" + is +
                                  "\"?)");
  EXPECT_THAT(refused("field"), EndsWith("No such file or directory"));
}

TEST_F(InputFile, IsReadWhollyUpToTheBound) {
  EXPECT_EQ(read_input(file(std::string(100, 'x')), "the trace", 100), std::string(100, 'x'));
  EXPECT_EQ(read_input(file(""), "the trace", 100), "");
  EXPECT_THAT(refusal([&] { read_input(file(std::string(101, 'x')), "the trace", 100); }),
              AllOf(HasSubstr("101 bytes"), HasSubstr("100")));
}

TEST_F(InputFile, OfTheKernelCountsByWhatComes) {
  EXPECT_THAT(refusal([] { read_input("/proc/self/status", "the trace", 100); }),
              HasSubstr("more than 100 bytes"));
}

TEST_F(InputFile, ScenariosAndWaypointsRefuseWhatMayNeverEnd) {
  for (const std::string& name : {std::string("/dev/zero"), pipe()}) {
    EXPECT_THAT(refusal([&] { load_scenario(name, {}); }),
                HasSubstr(name + "\": it is not a regular"));
    EXPECT_THAT(refusal([&] { load_waypoints(name); }),
                HasSubstr(name + "\": it is not a regular"));
  }
}

TEST(Printable, ShowsWhatATerminalWouldObey) {
  EXPECT_EQ(printable("a\x1b[2J\n\xc2\xb5"), "a\\x1b[2J\\x0a\\xc2\\xb5");
}

TEST(Printable, HasABound) {
  EXPECT_EQ(printable("abcdef", 3), "abc... (6 bytes)");
  EXPECT_EQ(printable("abc", 3), "abc");
  EXPECT_LT(printable(std::string(1 << 20, '\x1b')).size(), 10'000U);
}

TEST(Printable, KeepsLinesAndLettersOfAWholeMessage) {
  EXPECT_EQ(printable_message("±1 µm → ε\nnext"), "±1 µm → ε\nnext");
  EXPECT_EQ(printable_message("\x1b]0;x\x07\r"), "\\x1b]0;x\\x07\\x0d");
  EXPECT_EQ(printable_message("\xc2\x9b"), "\\xc2\\x9b");                    // CSI in one character
  EXPECT_EQ(printable_message("\xe2\x80\xae"), "\\xe2\\x80\\xae");           // right to left
  EXPECT_EQ(printable_message("\xff\xc3\xe2\x82"), "\\xff\\xc3\\xe2\\x82");  // no UTF-8
  EXPECT_LT(printable_message(std::string(1 << 20, 'x')).size(), 11'000U);
}

TEST(ErrorsAboutFiles, ShowWrongValuesSafelyAndNotWholly) {
  const auto refusal = [](const std::string& toml) -> std::string {
    try {
      parse_scenario(toml, "test.toml", {});
    } catch (const UsageError& error) {
      return error.what();
    }
    return "";
  };
  for (const std::string& text :
       {"[sensor]\nrate_hz = \"\\u001b[2J" + std::string(100'000, 'x') + "\"\n",
        "[sensor]\n\"\\u001b[2J" + std::string(100'000, 'x') + "\" = 1\n"}) {
    EXPECT_THAT(refusal(text), AllOf(HasSubstr("test.toml:2"), Not(HasSubstr("\x1b"))));
    EXPECT_LT(refusal(text).size(), 1000U);
  }
}

}  // namespace
}  // namespace tether
