#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <string>
#include <tether/all_messages.hpp>
#include <utility>
#include <vector>

#include "common/base/errors.hpp"
#include "tests/support/folder.hpp"
#include "tools/view/sources/gzip.hpp"
#include "tools/view/sources/one_file_page.hpp"
#include "tools/view/sources/recording.hpp"

namespace tether {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(OneFilePage, Base64IsThatOfRfc4648) {  // its section 10
  EXPECT_EQ(base64(""), "");
  EXPECT_EQ(base64("f"), "Zg==");
  EXPECT_EQ(base64("fo"), "Zm8=");
  EXPECT_EQ(base64("foo"), "Zm9v");
  EXPECT_EQ(base64("foobar"), "Zm9vYmFy");
  EXPECT_EQ(base64("\xff\xfe"), "//4=");
}

TEST(OneFilePage, GzipHasNoTimeAndShortensWhatRepeats) {
  const std::string packed = gzip(std::string(1'000'000, 'x'));
  EXPECT_LT(packed.size(), 2000U);
  EXPECT_EQ(packed.substr(0, 3), "\x1f\x8b\x08");
  EXPECT_EQ(packed.substr(4, 4), std::string(4, '\0'));
  EXPECT_EQ(packed, gzip(std::string(1'000'000, 'x')));
  EXPECT_GT(gzip("").size(), 10U);
}

TEST(OneFilePage, ImportsAreByBareNamesFromWhereverTheyAre) {
  std::vector<std::string> imported;
  const auto note = [&imported](const std::string& path) { imported.push_back(path); };
  EXPECT_EQ(with_bare_imports("import { a,\n  b } from \"../model/x.js\";\nimport \"./y.js\";\n"
                              "const text = \"./y.js\";\n",
                              "drawing/map.js", note),
            "import { a,\n  b } from \"tether/model/x.js\";\nimport \"tether/drawing/y.js\";\n"
            "const text = \"./y.js\";\n");
  EXPECT_THAT(imported, ElementsAre("model/x.js", "drawing/y.js"));
}

std::map<std::string, std::string> small_page() {
  return {{"index.html",
           "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
           "<link rel=\"stylesheet\" href=\"style.css\"><script src=\"old.js\"></script>"
           "<script type=\"module\" src=\"main.js\"></script></head><body></body></html>"},
          {"style.css", "p{}"},
          {"old.js", "1"},
          {"main.js", "import \"./model/a.js\";"},
          {"model/a.js", "import \"../main.js\";"},  // a circle
          {"unused.js", "2"}};
}

ReadPageFile reader(const std::map<std::string, std::string>& files) {
  return [&files](const std::string& path) -> std::optional<std::string> {
    const auto found = files.find(path);
    if (found == files.end()) return std::nullopt;
    return found->second;
  };
}

TEST(OneFilePage, HoldsAllThatThePageNeedsAndNamesNoFile) {
  const auto files = small_page();
  const std::string html = one_file_page(reader(files), "UkVD");
  EXPECT_THAT(html, HasSubstr("href=\"data:text/css;charset=utf-8;base64,cHt9\""));
  EXPECT_THAT(html, HasSubstr("src=\"data:text/javascript;charset=utf-8;base64,MQ==\""));
  EXPECT_THAT(html, HasSubstr("\"tether/main.js\":\"data:text/javascript;charset=utf-8;base64," +
                              base64("import \"tether/model/a.js\";")));
  EXPECT_THAT(html, HasSubstr("\"tether/model/a.js\":\"data:"));
  EXPECT_THAT(html, HasSubstr("<script type=\"module\">import \"tether/main.js\";</script>"));
  EXPECT_THAT(html, HasSubstr("<script id=\"recording\" type=\"text/plain\">UkVD</script>"));
  EXPECT_THAT(html, HasSubstr("default-src 'none'"));
  EXPECT_THAT(html, Not(HasSubstr("unused")));
  EXPECT_THAT(html, Not(HasSubstr("src=\"main.js\"")));
}

TEST(OneFilePage, AMissingFileIsNamed) {
  auto files = small_page();
  files.erase("model/a.js");
  try {
    one_file_page(reader(files), "");
    FAIL() << "nothing is missed";
  } catch (const UsageError& error) {
    EXPECT_THAT(error.what(), HasSubstr("model/a.js"));
  }
}

std::string big_endian(std::uint64_t value, int size) {
  std::string bytes;
  for (int i = size - 1; i >= 0; --i) bytes += static_cast<char>(value >> (8 * i));
  return bytes;
}

std::string event(std::int64_t time_us, const std::string& channel, const std::string& data) {
  return big_endian(EventLogReader::kMagic, 4) + big_endian(0, 8) +
         big_endian(static_cast<std::uint64_t>(time_us), 8) + big_endian(channel.size(), 4) +
         big_endian(data.size(), 4) + channel + data;
}

std::string pose(std::int64_t time_us, const std::string& channel) {
  pose_t message{};
  message.utime = time_us;
  std::string bytes(static_cast<std::size_t>(message.getEncodedSize()), '\0');
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return event(time_us, channel, bytes);
}

/// Poses each second from 0 to 4 s in turn on two channels, not in order, and something unknown.
ViewedLog log_in(const test::Folder& folder) {
  const auto file =
      folder.file("run.lcmlog", pose(1'000'000, "CTRL/POSE") + pose(0, "AGV/POSE") +
                                    event(500'000, "X", "unknown!") + pose(2'000'000, "AGV/POSE") +
                                    pose(3'000'000, "CTRL/POSE") + pose(4'000'000, "AGV/POSE"));
  return ViewedLog(file.string());
}

/// The header, and of each message time and channel.
std::pair<nlohmann::json, std::vector<std::string>> parts(const std::string& text) {
  std::istringstream lines(text);
  std::string line;
  std::getline(lines, line);
  std::pair<nlohmann::json, std::vector<std::string>> found{nlohmann::json::parse(line), {}};
  while (std::getline(lines, line)) found.second.push_back(line.substr(0, line.find(" {")));
  return found;
}

TEST(RecordingOfALog, HasTheMessagesInOrderOfTimeAndSaysWhatIsLeftOut) {
  const test::Folder folder;
  ViewedLog log = log_in(folder);
  const Recording recording = record(log, {});
  const auto [header, messages] = parts(recording.text);
  EXPECT_THAT(messages, ElementsAre("0 0", "1000000 1", "2000000 0", "3000000 1", "4000000 0"));
  EXPECT_EQ(header["count"], 5);
  EXPECT_EQ(header["channels"][1]["topic"], "CTRL/POSE");
  EXPECT_EQ(header["channels"][1]["schemaName"], "tether.pose_t");
  EXPECT_EQ(header["about"]["source"], "run.lcmlog") << "not the folder of its author";
  EXPECT_EQ(recording.left_out.count(), 1);
}

TEST(RecordingOfALog, OfAPartHasThatPartOnly) {
  const test::Folder folder;
  ViewedLog log = log_in(folder);
  EXPECT_THAT(parts(record(log, {1.0, 2.5}).text).second, ElementsAre("1000000 0", "2000000 1"));
  EXPECT_THROW(record(log, {10.0, 20.0}), UsageError);
}

TEST(RecordingOfALog, OfTooMuchIsRefusedWithWhatToDo) {
  const test::Folder folder;
  ViewedLog log = log_in(folder);
  try {
    record(log, {}, 300);
    FAIL() << "it is not refused";
  } catch (const UsageError& error) {
    EXPECT_THAT(error.what(), HasSubstr("--from"));
  }
}

}  // namespace
}  // namespace tether
