#include "common/lcm/lcm_url.hpp"

#include <gmock/gmock.h>

#include <ostream>
#include <string>

#include "common/base/errors.hpp"
#include "tests/support/refusal.hpp"

namespace tether {
namespace {

using testing::AllOf;
using testing::HasSubstr;

std::string url_refusal(const std::string& url) {
  return refusal_of([&] { checked_lcm_url(url); });
}

struct BadUrl {
  const char* url;
  const char* why;
};

void PrintTo(const BadUrl& bad, std::ostream* out) { *out << bad.url; }

struct BadLcmUrl : testing::TestWithParam<BadUrl> {};

TEST_P(BadLcmUrl, IsRefusedWithTheReasonAndWhatIsAllowed) {
  const auto& [url, why] = GetParam();
  EXPECT_THAT(url_refusal(url),
              AllOf(HasSubstr("LCM URL \"" + std::string(url) + "\": " + why + " ("),
                    HasSubstr("allowed: udpm://GROUP:PORT"),
                    HasSubstr("udpm://239.255.76.67:7667?ttl=0"), HasSubstr("tcpq://HOST:PORT")));
}

constexpr BadUrl kBadUrls[] = {
    {"", "not an LCM URL that Tether can use"},
    {"garbage", "not an LCM URL that Tether can use"},
    {"udpm:", "not an LCM URL that Tether can use"},
    {"udpm:/239.255.76.67:7667", "not an LCM URL that Tether can use"},
    {"UDPM://239.255.76.67:7667", "not an LCM URL that Tether can use"},
    {" udpm://239.255.76.67:7667", "not an LCM URL that Tether can use"},
    {"udpm://239.255.76.67:7667/x", "not an LCM URL that Tether can use"},
    {"memq://", "not an LCM URL that Tether can use"},
    {"file:///tmp/run.lcmlog", "not an LCM URL that Tether can use"},
    {"udpm://", "no multicast group"},
    {"udpm://:7667", "no multicast group"},
    {"udpm://239.255.76.67", "no port"},
    {"udpm://239.255.76.67?ttl=0", "no port"},
    {"udpm://239.255.76.67:", "no port"},
    {"udpm://239.255.76.67:0", "port \"0\" is not a number from 1 to 65535"},
    {"udpm://239.255.76.67:65536", "port \"65536\" is not a number from 1 to 65535"},
    {"udpm://239.255.76.67:-1", "port \"-1\" is not a number from 1 to 65535"},
    {"udpm://239.255.76.67:+7667", "port \"+7667\" is not a number from 1 to 65535"},
    {"udpm://239.255.76.67:abc", "port \"abc\" is not a number from 1 to 65535"},
    {"udpm://239.255.76.67:7667 ", "port \"7667 \" is not a number from 1 to 65535"},
    {"udpm://239.255.76.67:99999999999999999999",
     "port \"99999999999999999999\" is not a number from 1 to 65535"},
    {"udpm://192.168.1.1:7667", "192.168.1.1 is not a multicast group"},
    {"udpm://223.255.255.255:7667", "223.255.255.255 is not a multicast group"},
    {"udpm://240.0.0.0:7667", "240.0.0.0 is not a multicast group"},
    {"udpm://localhost:7667", "\"localhost\" is not an IPv4 address"},
    {"udpm://239.255.76:7667", "\"239.255.76\" is not an IPv4 address"},
    {"udpm://239.255.76.256:7667", "\"239.255.76.256\" is not an IPv4 address"},
    {"udpm://239.255.76.67:7667?ttl=256", "bad option \"ttl=256\""},
    {"udpm://239.255.76.67:7667?ttl=-1", "bad option \"ttl=-1\""},
    {"udpm://239.255.76.67:7667?ttl=", "bad option \"ttl=\""},
    {"udpm://239.255.76.67:7667?ttl", "bad option \"ttl\""},
    {"udpm://239.255.76.67:7667?TTL=1", "bad option \"TTL=1\""},
    {"udpm://239.255.76.67:7667?recv_buf_size=0", "bad option \"recv_buf_size=0\""},
    {"udpm://239.255.76.67:7667?recv_buf_size=2147483648",
     "bad option \"recv_buf_size=2147483648\""},
    {"udpm://239.255.76.67:7667?ttl=0&rcv_buf_size=1", "bad option \"rcv_buf_size=1\""},
    {"udpm://239.255.76.67:7667?ttl=0&&ttl=1", "bad option \"\""},
    {"udpm://239.255.76.67:7667?ttl=0&", "bad option \"\""},
    {"tcpq://:7700", "no host"},
    {"tcpq://localhost", "no port"},
    {"tcpq://localhost:7700?ttl=1", "tcpq has no options"},
};

INSTANTIATE_TEST_SUITE_P(LcmUrl, BadLcmUrl, testing::ValuesIn(kBadUrls));

TEST(LcmUrl, GetsALargeReceiveBufferUnlessItNamesOne) {
  EXPECT_EQ(checked_lcm_url("udpm://239.255.76.67:7667"),
            "udpm://239.255.76.67:7667?recv_buf_size=2097152");
  EXPECT_EQ(checked_lcm_url("udpm://239.255.76.67:7667?"),
            "udpm://239.255.76.67:7667?recv_buf_size=2097152");
  EXPECT_EQ(checked_lcm_url(kDefaultLcmUrl),
            "udpm://239.255.76.67:7667?ttl=0&recv_buf_size=2097152");
  EXPECT_EQ(checked_lcm_url("udpm://224.0.0.0:1?recv_buf_size=1&ttl=255"),
            "udpm://224.0.0.0:1?recv_buf_size=1&ttl=255");
}

TEST(LcmUrl, MayBeAtTheEdgesOfWhatIsAllowed) {
  for (const std::string url :
       {"udpm://224.0.0.0:65535", "udpm://239.255.255.255:1", "tcpq://localhost:7700",
        "tcpq://10.0.0.1:1", "udpm://239.255.76.67:7667?ttl=1&recv_buf_size=2147483647"}) {
    EXPECT_EQ(url_refusal(url), "accepted") << url;
  }
}

TEST(LcmUrl, ACheckedUrlStaysAsItIs) {
  const std::string checked = checked_lcm_url(kDefaultLcmUrl);
  EXPECT_EQ(checked_lcm_url(checked), checked);
}

TEST(LcmUrl, NamesItsMulticastGroup) {
  EXPECT_EQ(multicast_group(checked_lcm_url(kDefaultLcmUrl)), "239.255.76.67");
  EXPECT_EQ(multicast_group("tcpq://localhost:7700"), "");
}

TEST(LcmUrl, TheNextPortIsANetworkOfOnesOwn) {
  EXPECT_EQ(with_next_port("udpm://239.255.76.67:7667?ttl=0"), "udpm://239.255.76.67:7668?ttl=0");
  EXPECT_EQ(with_next_port("udpm://239.255.76.67:65535"), "udpm://239.255.76.67:1024");
  EXPECT_EQ(with_next_port("tcpq://10.0.0.1:7700"), "tcpq://10.0.0.1:7701");
}

}  // namespace
}  // namespace tether
