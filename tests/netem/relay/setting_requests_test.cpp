#include <gmock/gmock.h>

#include "netem/relay/live_settings.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using test::at_s;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

/// A loop whose aside() tasks are done a second later.
class SlowAside final : public EventLoop {
 public:
  explicit SlowAside(VirtualLoop& loop) : loop_(loop) {}

  void aside(std::function<void()> work, Task then) override {
    work();
    loop_.at(loop_.now() + std::chrono::seconds{1}, Priority::node, std::move(then));
  }
  Instant now() const override { return loop_.now(); }
  double rate() const override { return 1.0; }
  void at(Instant when, Priority priority, Task task) override {
    loop_.at(when, priority, std::move(task));
  }
  void every(Instant first, Duration period, Priority priority, Task task) override {
    loop_.every(first, period, priority, std::move(task));
  }
  void add_fd(int, Task) override {}
  void remove_fd(int) override {}
  void stop() override { loop_.stop(); }
  std::uint64_t slips() const override { return 0; }

 private:
  VirtualLoop& loop_;
};

/// Settings that begin with "file" have to be prepared.
struct SettingRequestsTest : ::testing::Test {
  void ask(const std::string& setting, std::int64_t seq) {
    requests.take(setting_request(0, seq, {setting}));
  }

  VirtualLoop clock;
  SlowAside loop{clock};
  InProcessBus bus{clock};
  int prepared = 0;
  std::vector<std::string> applied;
  SettingRequests requests{loop,
                           {&bus},
                           ChannelNames("AGV"),
                           [this](const std::vector<std::string>& settings) {
                             std::function<void()> work;
                             if (settings.front().starts_with("file"))
                               work = [this] { ++prepared; };
                             return work;
                           },
                           [this](const std::vector<std::string>& settings) {
                             applied.push_back(settings.front());
                             return std::vector<ChannelSetting>{};
                           }};
};

TEST_F(SettingRequestsTest, AreAppliedInOrderThoughOneHasToBePrepared) {
  ask("a=1", 1);
  ask("file=2", 2);
  ask("b=3", 3);
  ask("file=4", 4);
  EXPECT_THAT(applied, ElementsAre("a=1"));
  clock.run_until(at_s(1.0));
  EXPECT_THAT(applied, ElementsAre("a=1", "file=2", "b=3"));
  clock.run_until(at_s(2.0));
  EXPECT_THAT(applied, ElementsAre("a=1", "file=2", "b=3", "file=4"));
}

TEST_F(SettingRequestsTest, ThatComeAgainWhileTheyArePreparedAreAppliedOnce) {
  for (int i = 0; i < 3; ++i) ask("file=1", 1);
  clock.run_until(at_s(9.0));
  EXPECT_THAT(applied, ElementsAre("file=1"));
  EXPECT_EQ(prepared, 1);
}

TEST_F(SettingRequestsTest, BeyondAHundredThatWaitAreRefused) {
  for (int i = 0; i < 102; ++i) ask("file=1", i);
  CounterList counters;
  requests.list_counters(counters);
  EXPECT_THAT(counters, ElementsAre(std::pair<std::string, std::int64_t>("settings.refused", 2)));
  EXPECT_THAT(applied, IsEmpty());
}

}  // namespace
}  // namespace tether
