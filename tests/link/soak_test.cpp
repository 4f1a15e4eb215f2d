#include <gtest/gtest.h>
#include <malloc.h>

#include "tests/link/two_hosts.hpp"

namespace tether::link {
namespace {

using std::chrono::hours;
using std::chrono::milliseconds;

using testing::TwoHosts;

/// Three messages a second, some of several datagrams, for this long; the received ones are counted
/// and forgotten.
std::int64_t live(TwoHosts& net, Duration time) {
  std::int64_t heard = 0;
  const Bytes command(100, 1), big(4000, 2);
  for (const Instant end = net.now + time; net.now < end;) {
    net.send(0, "CMD", command);
    net.send(0, "BIG", big);
    net.send(1, "POSE", command);
    net.run(milliseconds{1000});
    for (auto& host : net.hosts) {
      heard += static_cast<std::int64_t>(host.heard.size());
      host.heard.clear();
    }
  }
  return heard;
}

// Leftovers of a session, an outage or a message would grow with their number, not with time:
// three sessions and three outages an hour are a day's in eight hours.
TEST(Soak, TwentySessionsOfLossAndOutagesLeaveNothingBehind) {
  for (const bool deferred : {false, true}) {
    LinkSettings settings = testing::two_paths();
    if (deferred) settings.second_after = milliseconds{20};
    settings.rekey.after = std::chrono::minutes{20};
    TwoHosts net(settings);
    net.tick = milliseconds{50};
    RandomEngine random(1);
    net.loses = [&](const TwoHosts::Datagram& d) {
      // The paths lose 10 and 5 %, and nothing passes for 10 s of each 20 minutes.
      const std::int64_t second =
          std::chrono::floor<std::chrono::seconds>(net.now.time_since_epoch()).count();
      return second % 1200 > 1190 || uniform_01(random) < (d.path == 0 ? 0.1 : 0.05);
    };
    live(net, hours{1});
    const std::size_t before = mallinfo2().uordblks;
    const std::int64_t heard = live(net, hours{7});
    const std::size_t after = mallinfo2().uordblks;
    EXPECT_LT(after, before + 30'000) << "bytes in use";
    EXPECT_GE(net.link(0).sessions().count(), 20);
    // Three messages per second, without those of the outages and of twice lost datagrams: a BIG
    // one has three, and the product of the losses is 0.5 %.
    EXPECT_GT(static_cast<double>(heard), 0.98 * 3 * 7 * 3600);
    EXPECT_EQ(net.refused(0).forged + net.refused(1).forged, 0);
  }
}

}  // namespace
}  // namespace tether::link
