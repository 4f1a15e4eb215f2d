#include "doors/link/node/config.hpp"

#include <gmock/gmock.h>
#include <sys/stat.h>
#include <unistd.h>

#include "tests/support/folder.hpp"
#include "tests/support/refusal.hpp"

namespace tether::link {
namespace {

using ::testing::HasSubstr;

const std::string kPaths =
    "key = \"own.key\"\n[[path]]\nname = \"wifi\"\nbind = \"0.0.0.0:7700\"\n"
    "[[path]]\nname = \"5g\"\nbind = \"10.0.0.1:7701\"\ninterface = \"wwan0\"\n";
const std::string kPeer =
    "[[peer]]\nname = \"vehicle7\"\npublic_key = \"" + std::string(64, '1') +
    "\"\naddresses = [\"192.0.2.7:7700\", \"\"]\nsend = [\"CTRL/(CMD_VEL|PLAN) -> AGV/$1\"]\n"
    "receive = [\"AGV/.*\"]\nlatest_only = [\"AGV/(POSE|CMD_VEL)\"]\n";

std::string refusal(const std::string& text) {
  return refusal_of([&] { parse_link_config(text, "/etc/tether/link.toml"); });
}

TEST(LinkConfig, IsReadWhole) {
  const LinkConfig c = parse_link_config(kPaths + kPeer, "/etc/tether/link.toml");
  EXPECT_EQ(c.key_file, "/etc/tether/own.key");
  ASSERT_EQ(c.paths.size(), 2U);
  EXPECT_EQ(to_text(c.paths[1].bind), "10.0.0.1:7701");
  EXPECT_EQ(c.paths[1].interface, "wwan0");
  EXPECT_EQ(c.settings.datagram_bytes, 1372U);
  EXPECT_FALSE(c.settings.second_after);
  ASSERT_EQ(c.peers.size(), 1U);
  const PeerSetup& peer = c.peers[0].setup;
  EXPECT_EQ(to_text(peer.addresses.at(0).value()), "192.0.2.7:7700");
  EXPECT_FALSE(peer.addresses.at(1));
  EXPECT_EQ(peer.rules.send.name_of("CTRL/PLAN"), "AGV/PLAN");
  EXPECT_EQ(peer.rules.send.name_of("CTRL/PRELOAD"), std::nullopt);
  EXPECT_TRUE(peer.rules.receive.has("AGV/POSE"));
  EXPECT_FALSE(peer.rules.receive.has("XAGV/POSE"));
  EXPECT_EQ(c.clock_warning, std::chrono::milliseconds{50});
  EXPECT_EQ(c.settings.clock_limit, std::chrono::milliseconds{200});
  EXPECT_TRUE(peer.rules.timed.has("AGV/PLAN") && peer.rules.timed.has("AGV/PRELOAD"));
  EXPECT_FALSE(peer.rules.timed.has("AGV/CMD_VEL"));
  const LinkConfig other = parse_link_config(
      "clock_limit_ms = 20\n" + kPaths + kPeer + "timed = [\"AGV/CMD_VEL\"]\n", "/etc/link.toml");
  EXPECT_EQ(other.settings.clock_limit, std::chrono::milliseconds{20});
  EXPECT_TRUE(other.peers[0].setup.rules.timed.has("AGV/CMD_VEL"));
}

TEST(LinkConfig, RefusalsNameFileLineAndWhatIsAllowed) {
  EXPECT_THAT(refusal("nonsense = 1\n" + kPaths + kPeer), HasSubstr("link.toml:1: unknown key"));
  EXPECT_THAT(refusal("mtu = 500\n" + kPaths + kPeer), HasSubstr("from 576 to 65535"));
  EXPECT_THAT(refusal("clock_warning_ms = 0\n" + kPaths + kPeer), HasSubstr("from 1 to 60000"));
  EXPECT_THAT(refusal("second_path = \"never\"\n" + kPaths + kPeer), HasSubstr("\"deferred\""));
  EXPECT_THAT(refusal("second_after_ms = 5\n" + kPaths + kPeer), HasSubstr("does nothing"));
  EXPECT_THAT(refusal("lcm_url = \"tcpq://localhost:7700\"\n" + kPaths + kPeer), HasSubstr("udpm"));
  EXPECT_THAT(refusal("lcm_url = \"udpm://239.255.76.67:7667?ttl=1\"\n" + kPaths + kPeer),
              HasSubstr("ttl=0"));
  EXPECT_THAT(refusal(kPaths), HasSubstr("0 tables [[peer]]"));
  EXPECT_THAT(refusal("key = \"k\"\n" + kPeer), HasSubstr("0 tables [[path]]"));
  EXPECT_THAT(refusal(kPaths + kPeer + kPeer), HasSubstr("two peers are called \"vehicle7\""));
  EXPECT_THAT(refusal(kPaths + "[[peer]]\nname = \"v\"\npublic_key = \"12\"\n"),
              HasSubstr("tether-link show"));
}

TEST(LinkConfig, RefusesAddressesThatAreNone) {
  for (const char* const text : {"", "192.0.2.7", "192.0.2.7:", "192.0.2.7:0", "192.0.2.7:65536",
                                 "host:7700", "192.0.2:7700", ":7700", "192.0.2.7:7700 "}) {
    EXPECT_THAT(refusal_of([&] { address_from_text(text); }), HasSubstr("such as")) << text;
  }
}

TEST(LinkConfig, RefusesRulesThatMeanNothing) {
  for (const char* const rule : {"(", "A ->", "-> B", "A -> $1", "(A) -> $2", "A -> $x",
                                 "A -> B -> C", "A -> LINK/REPORT"}) {
    const std::string text = kPaths + "[[peer]]\nname = \"v\"\npublic_key = \"" +
                             std::string(64, '1') + "\"\nsend = ['" + std::string(rule) + "']\n";
    EXPECT_THAT(refusal(text), HasSubstr("link.toml:12: ")) << rule;
    EXPECT_THAT(refusal(text), HasSubstr("send")) << rule;
  }
  const std::string peer =
      "[[peer]]\nname = \"v\"\npublic_key = \"" + std::string(64, '1') + "\"\n";
  EXPECT_THAT(refusal(kPaths + peer + "receive = ['A -> B']\n"), HasSubstr("only `send` renames"));
}

TEST(LinkConfig, NamesFitIntoLinesAndFileNames) {
  for (const char* const name : {"../x", "a b", "a\\nb", ".a"}) {
    const std::string text =
        "key = \"k\"\n[[path]]\nname = \"" + std::string(name) + "\"\nbind = \"0.0.0.0:7700\"\n";
    EXPECT_THAT(refusal(text + kPeer), HasSubstr("letters, digits")) << name;
  }
}

TEST(LinkConfig, TwoPathsDoNotShareASocket) {
  const std::string path = "bind = \"0.0.0.0:7700\"\n";
  const std::string two =
      "key = \"k\"\n[[path]]\nname = \"a\"\n" + path + "[[path]]\nname = \"b\"\n" + path;
  EXPECT_THAT(refusal(two + kPeer), HasSubstr("two paths bind to 0.0.0.0:7700"));
  EXPECT_EQ(refusal(two + "interface = \"wwan0\"\n" + kPeer), "accepted");
}

TEST(LinkConfig, IsRefusedIfOthersMayWriteIt) {
  const tether::test::Folder folder;
  const std::string file = folder.file("link.toml", kPaths + kPeer).string();
  ASSERT_EQ(chmod(file.c_str(), 0664), 0);
  EXPECT_THAT(refusal_of([&] { load_link_config(file); }), HasSubstr("chmod go-w"));
  ASSERT_EQ(chmod(file.c_str(), 0644), 0);
  EXPECT_EQ(refusal_of([&] { load_link_config(file); }), "accepted");
  if (geteuid() == 0) {
    ASSERT_EQ(chown(file.c_str(), 65534, 65534), 0);
    EXPECT_THAT(refusal_of([&] { load_link_config(file); }), HasSubstr("another user's"));
  }
}

}  // namespace
}  // namespace tether::link
