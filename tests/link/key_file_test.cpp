#include "doors/link/key_file.hpp"

#include <gmock/gmock.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <new>

#include "tests/link/two_hosts.hpp"
#include "tests/support/folder.hpp"
#include "tests/support/refusal.hpp"

namespace tether::link {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using tether::test::Folder;

mode_t mode_of(const std::string& file) {
  struct stat about {};
  EXPECT_EQ(stat(file.c_str(), &about), 0);
  return about.st_mode & 07777;
}

struct KeyFile {
  Folder folder;
  std::string path = (folder.path / "own.key").string();
  KeyPair pair = key_pair_of(testing::key_number(1));
  KeyFile() { write_key_file(path, pair); }
  std::string refusal() const {
    return refusal_of([this] { read_key_file(path); });
  }
};

TEST(KeyFile, IsReadAsItWasWrittenAndIsItsOwnersAlone) {
  const KeyFile file;
  EXPECT_EQ(mode_of(file.path), 0600U);
  EXPECT_EQ(read_key_file(file.path).secret_key, file.pair.secret_key);
  EXPECT_EQ(read_key_file(file.path).public_key, file.pair.public_key);
}

TEST(KeyFile, IsNeverOverwritten) {
  const KeyFile file;
  EXPECT_THAT(refusal_of([&] { write_key_file(file.path, file.pair); }),
              HasSubstr("exists already"));
}

TEST(KeyFile, IsRefusedIfOthersMayReadOrWriteIt) {
  const KeyFile file;
  for (const mode_t mode : {0640, 0604, 0620, 0660, 0644}) {
    ASSERT_EQ(chmod(file.path.c_str(), mode), 0);
    EXPECT_THAT(file.refusal(), AllOf(HasSubstr(file.path), HasSubstr("chmod 600"))) << mode;
  }
  ASSERT_EQ(chmod(file.path.c_str(), 0400), 0);
  EXPECT_EQ(file.refusal(), "accepted");
}

TEST(KeyFile, IsRefusedIfItIsNone) {
  const Folder folder;
  const std::string secret(64, 'a');
  for (const std::string& text :
       {std::string(""), std::string("secret_key = 1"), "secret_key = \"" + secret + "\"",
        "secret_key = " + secret,
        "secret_key = \"" + secret + "\"\npublic_key = \"" + secret + "\"",
        std::string(5000, '#')}) {
    const std::string path = folder.file("bad.key", text).string();
    chmod(path.c_str(), 0600);
    const std::string refusal = refusal_of([&] { read_key_file(path); });
    EXPECT_THAT(refusal, AllOf(HasSubstr(path), Not(HasSubstr("aaaa")))) << text;
  }
  EXPECT_THAT(refusal_of([&] { read_key_file(folder.path.string()); }),
              HasSubstr("no regular file"));
  EXPECT_THAT(refusal_of([&] { read_key_file((folder.path / "none").string()); }),
              HasSubstr("keygen"));
}

TEST(KeyText, IsHexadecimalOfExactlyOneKey) {
  const Key key = testing::key_number(4);
  EXPECT_EQ(key_from_text(key_text(key)), key);
  EXPECT_FALSE(key_from_text(key_text(key).substr(1)));
  EXPECT_FALSE(key_from_text(key_text(key) + "0"));
  EXPECT_FALSE(key_from_text(""));
  EXPECT_FALSE(key_from_text(std::string(64, 'x')));
}

TEST(KeyPair, WipesItsSecret) {
  alignas(KeyPair) std::array<std::uint8_t, sizeof(KeyPair)> room{};
  auto* pair = new (room.data()) KeyPair(key_pair_of(testing::key_number(1)));
  const Key secret = pair->secret_key;
  const auto holds = [&] {
    return std::search(room.begin(), room.end(), secret.begin(), secret.end()) != room.end();
  };
  EXPECT_TRUE(holds());
  pair->~KeyPair();
  EXPECT_FALSE(holds());
}

}  // namespace
}  // namespace tether::link
