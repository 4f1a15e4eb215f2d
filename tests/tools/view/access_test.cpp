#include "tools/view/server/access.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "common/base/errors.hpp"
#include "tools/view/server/page_folder.hpp"

namespace tether {
namespace {

using ::testing::HasSubstr;

const AccessRules kOpen{8765, "", {"https://app.foxglove.dev"}};
const std::string kToken = "0123456789abcdef";
const AccessRules kClosed{8765, kToken, {}};

bool passes(const AccessRules& rules, const AccessRequest& request) {
  return why_refused(rules, request).empty();
}

TEST(ViewAccess, ThisMachineIsLetIn) {
  for (const char* host :
       {"127.0.0.1:8765", "localhost:8765", "LOCALHOST:8765", "[::1]:8765", "127.0.0.2:8765"}) {
    EXPECT_TRUE(passes(kOpen, {"/", host, "", ""})) << host;
  }
}

TEST(ViewAccess, AnotherNameForThisMachineIsNot) {  // DNS rebinding
  for (const char* host : {"evil.example:8765", "127.0.0.1.evil.example:8765", "127.0.0.1",
                           "127.0.0.1:80", "localhost:8765.evil.example", "127.evil.example.x:8765",
                           "", "[::1]", "a b:8765", "127.0.0.1:8765;script-src *"}) {
    EXPECT_FALSE(passes(kOpen, {"/", host, "", ""})) << host;
  }
}

TEST(ViewAccess, OtherSitesPagesAreNotUnlessTheyAreNamed) {
  const auto from = [](const std::string& origin) {
    return passes(kOpen, {"/", "127.0.0.1:8765", origin, ""});
  };
  EXPECT_TRUE(from("http://127.0.0.1:8765"));
  EXPECT_TRUE(from("https://app.foxglove.dev"));
  for (const char* origin :
       {"http://evil.example", "https://127.0.0.1:8765", "null", "http://127.0.0.1:8766",
        "http://localhost:8765", "https://app.foxglove.dev.evil.example"}) {
    EXPECT_FALSE(from(origin)) << origin;
  }
}

TEST(ViewAccess, AnOriginIsASchemeAndAHostAndNothingAfterThem) {
  for (const char* origin : {"https://app.foxglove.dev", "http://127.0.0.1:8080", "http://[::1]:80",
                             "vscode-webview://0a1b"}) {
    EXPECT_TRUE(is_origin(origin)) << origin;
  }
  for (const char* other : {"foo", "app.foxglove.dev", "https://app.foxglove.dev/", "https://", "",
                            "://x", "https://App.foxglove.dev", "https://x/y", "https://a b",
                            "null", "*", "https://*.foxglove.dev"}) {
    EXPECT_FALSE(is_origin(other)) << other;
  }
}

TEST(ViewAccess, ATokenIsWantedOfEachRequestInItsAddressOrItsCookie) {
  const std::string host = "10.0.0.7:8765";
  EXPECT_THAT(why_refused(kClosed, {"/", host, "", ""}), HasSubstr("token"));
  EXPECT_TRUE(passes(kClosed, {"/?token=" + kToken, host, "", ""}));
  EXPECT_TRUE(passes(kClosed, {"/?a=b&token=" + kToken, host, "", ""}));
  EXPECT_TRUE(passes(kClosed, {"/", host, "http://" + host, "x=y; tether_view_8765=" + kToken}));
  EXPECT_FALSE(passes(kClosed, {"/?token=" + kToken + "0", host, "", ""}));
  EXPECT_FALSE(passes(kClosed, {"/?token=", host, "", "tether_view_8765="}));
  EXPECT_FALSE(passes(kClosed, {"/?xtoken=" + kToken, host, "", ""}));
  EXPECT_FALSE(passes(kClosed, {"/", host, "", "tether_view_8766=" + kToken}));
  EXPECT_FALSE(passes(kClosed, {"/?token=" + kToken, host, "http://evil.example", ""}));
}

TEST(ViewAccess, LoopbackIsWhatOtherMachinesCannotReach) {
  for (const char* address : {"127.0.0.1", "127.1.2.3", "::1"}) EXPECT_TRUE(is_loopback(address));
  for (const char* address : {"0.0.0.0", "::", "10.0.0.1", "127.0.0.1.evil.com", "127."}) {
    EXPECT_FALSE(is_loopback(address)) << address;
  }
}

TEST(ViewAccess, TokensDiffer) {
  EXPECT_EQ(random_token().size(), 32);
  EXPECT_NE(random_token(), random_token());
}

struct ViewPage : ::testing::Test {
  ViewPage() {
    std::string name = (std::filesystem::temp_directory_path() / "view_XXXXXX").string();
    root = mkdtemp(name.data());
    folder = root / "page";
    std::filesystem::create_directories(folder / "js");
    write(folder / "index.html", "the page");
    write(folder / "js" / "a.js", "code");
    write(folder / ".hidden.html", "no");
    write(folder / "core", "no");
    write(root / "secret.txt", "secret");
    std::filesystem::create_symlink(root / "secret.txt", folder / "link.txt");
  }
  ~ViewPage() override { std::filesystem::remove_all(root); }
  ViewPage(const ViewPage&) = delete;
  ViewPage& operator=(const ViewPage&) = delete;

  static void write(const std::filesystem::path& file, const std::string& text) {
    std::ofstream(file) << text;
  }

  std::filesystem::path root, folder;
};

TEST_F(ViewPage, FilesHaveTheirTypes) {
  const PageFolder page(folder);
  EXPECT_EQ(page.find("/")->bytes, "the page");
  EXPECT_EQ(page.find("/")->type, "text/html; charset=utf-8");
  EXPECT_EQ(page.find("/js/a.js")->type, "text/javascript; charset=utf-8");
}

TEST_F(ViewPage, NothingElseIsFound) {
  const PageFolder page(folder);
  for (const char* path :
       {"", "/..", "/../secret.txt", "/js/../index.html", "/%2e%2e/secret.txt", "//etc/passwd",
        "/link.txt", "/.hidden.html", "/core", "index.html", "/js", "/js/"}) {
    EXPECT_FALSE(page.find(path)) << path;
  }
  std::filesystem::remove(folder / "js" / "a.js");
  EXPECT_FALSE(page.find("/js/a.js"));
}

TEST_F(ViewPage, AFolderWithoutAPageIsRefused) {
  EXPECT_THROW(PageFolder(folder / "js"), UsageError);
  EXPECT_THROW(PageFolder(folder / "nowhere"), UsageError);
}

}  // namespace
}  // namespace tether
