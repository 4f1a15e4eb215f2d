#include "tools/metrics/network_metrics.hpp"

#include <gmock/gmock.h>

#include <limits>
#include <tether/controller_report_t.hpp>
#include <tether/counters_t.hpp>
#include <tether/drivetrain_state_t.hpp>
#include <tether/peer_report_t.hpp>

#include "common/node/channel_names.hpp"

namespace tether {
namespace {

using namespace std::chrono_literals;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

constexpr Instant kStart{5s};

template <class Message>
std::vector<std::uint8_t> encoded(const Message& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

counters_t counters(const std::string& node, const std::string& name, std::int64_t value) {
  counters_t c{};
  c.node = node;
  c.count = 1;
  c.name = {name};
  c.value = {value};
  return c;
}

/// Report of one path, on which only sent datagrams are known.
peer_report_t report(const std::string& peer) {
  peer_report_t r{};
  r.peer = peer;
  r.age_s = -1.0;
  r.paths = 1;
  r.path = {"wifi"};
  r.path_alive = {0};
  r.path_age_s = r.path_loss = r.path_delay_min_ms = r.path_delay_max_ms = r.path_worst_min_ms =
      r.path_worst_max_ms = r.path_round_trip_ms = {-1.0};
  r.path_gap_s = r.path_burst_mean = {0.0};
  r.path_sent = {7};
  r.path_unsent = r.path_dropped = r.path_received = r.path_first = r.path_lost = r.path_bursts =
      r.path_burst_longest = {0};
  return r;
}

class MetricsTest : public testing::Test {
 protected:
  template <class Message>
  void hear(const std::string& channel, const Message& message, Instant now = kStart) {
    metrics_.on_message(now, channel, encoded(message));
  }
  std::string text(Instant now = kStart) const { return metrics_.text(now, {}); }

  NetworkMetrics metrics_;
};

TEST_F(MetricsTest, SaysNothingOfWhatWasNeverHeard) {
  EXPECT_THAT(text(), AllOf(Not(HasSubstr("tether_link")), Not(HasSubstr("tether_drivetrain")),
                            Not(HasSubstr("tether_channel"))));
  EXPECT_THAT(text(), HasSubstr("tether_metrics_messages_ignored_total 0\n"));
}

TEST_F(MetricsTest, HasNoValueForWhatAReportDoesNotKnow) {
  hear("LINK/REPORT", report("AGV1"));
  EXPECT_THAT(
      text(),
      AllOf(HasSubstr("tether_link_up{peer=\"AGV1\"} 0\n"),
            HasSubstr("tether_link_path_datagrams_sent_total{peer=\"AGV1\",path=\"wifi\"} 7\n"),
            Not(HasSubstr("tether_link_age_seconds")), Not(HasSubstr("offset")),
            Not(HasSubstr("loss")), Not(HasSubstr("delay")), Not(HasSubstr("round_trip"))));
}

TEST_F(MetricsTest, GivesTimesInSecondsAndNegativeOffsetsAsTheyAre) {
  peer_report_t r = report("AGV1");
  r.offset_known = 1;
  r.offset_min_ms = -3.0;
  r.offset_max_ms = 1.5;
  r.path_delay_min_ms = {-0.5};
  r.path_delay_max_ms = {4.0};
  hear("LINK/REPORT", r);
  EXPECT_THAT(
      text(),
      AllOf(HasSubstr("tether_link_clock_offset_min_seconds{peer=\"AGV1\"} -0.003\n"),
            HasSubstr("tether_link_clock_offset_max_seconds{peer=\"AGV1\"} 0.0015\n"),
            HasSubstr("tether_link_path_delay_min_seconds{peer=\"AGV1\",path=\"wifi\"} -0.0005\n"),
            HasSubstr("tether_link_path_delay_max_seconds{peer=\"AGV1\",path=\"wifi\"} 0.004\n")));
}

TEST_F(MetricsTest, AgesGrowWhileNothingIsHeard) {
  drivetrain_state_t state{};
  state.state_name = "armed";
  state.command_age_s = 0.25;
  hear("CAN7/STATE", state);
  EXPECT_THAT(text(kStart + 10s),
              AllOf(HasSubstr("tether_drivetrain_command_age_seconds{vehicle=\"AGV7\"} 10.25\n"),
                    HasSubstr("tether_drivetrain_state{vehicle=\"AGV7\",state_name=\"armed\"} 1\n"),
                    HasSubstr("tether_channel_age_seconds{channel=\"CAN7/STATE\"} 10\n")));
}

TEST_F(MetricsTest, ABridgeWithoutACommandHasNoAgeOfIt) {
  drivetrain_state_t state{};
  state.command_age_s = -1.0;
  hear("CAN/STATE", state);
  EXPECT_THAT(text(kStart + 10s), Not(HasSubstr("command_age")));
}

TEST_F(MetricsTest, AControllerWithoutAPoseHasNoAgeOfIt) {
  controller_report_t decided{};
  decided.pose_seq = -1;
  hear("CTRL/REPORT", decided);
  EXPECT_THAT(text(), Not(HasSubstr("pose_age")));
  decided.pose_seq = 0;
  decided.pose_age_s = 0.5;
  hear("CTRL/REPORT", decided);
  EXPECT_THAT(text(), HasSubstr("tether_controller_pose_age_seconds{vehicle=\"AGV\"} 0.5\n"));
}

TEST_F(MetricsTest, TellsVehiclesAndNodesApart) {
  hear("CTRL-forklift/COUNTERS", counters("controller", "pose.stale", 1));
  hear("CAN/COUNTERS", counters("can_bridge", "pose.stale", 2));
  hear("AGV/COUNTERS", counters("autonomy", "loop.slips", 3));
  EXPECT_THAT(text(),
              AllOf(HasSubstr("tether_node_events_total{vehicle=\"forklift\",node=\"controller\","
                              "event=\"pose.stale\"} 1\n"),
                    HasSubstr("tether_node_events_total{vehicle=\"AGV\",node=\"can_bridge\","
                              "event=\"pose.stale\"} 2\n"),
                    HasSubstr("tether_loop_slips_total{vehicle=\"AGV\",node=\"autonomy\"} 3\n")));
}

TEST_F(MetricsTest, EachChannelOfAVehicleIsLabelledByItsName) {
  for (const std::string name :
       {"AGV", "AGV7", "AGVX", "AGV7-b", "forklift", "7", "C", "N-1", "can"}) {
    metrics_ = NetworkMetrics();
    const ChannelNames c(name);
    hear(c.can_counters, counters("can_bridge", "x", 1));
    hear(c.control_counters, counters("controller", "x", 1));
    hear(c.net_counters, counters("netem", "x", 1));
    hear(c.sim_counters, counters("sim", "x", 1));
    hear(c.autonomy_counters, counters("autonomy", "x", 1));
    hear(c.localiser_counters, counters("localiser", "x", 1));
    for (const char* node : {"can_bridge", "controller", "netem", "sim", "autonomy", "localiser"}) {
      EXPECT_THAT(text(), HasSubstr("tether_node_events_total{vehicle=\"" + name + "\",node=\"" +
                                    node + "\""));
    }
  }
}

TEST_F(MetricsTest, CountsWhatItMissesByNumbers) {
  for (const std::int64_t seq : {0, 1, 4}) {
    counters_t c = counters("sim", "x", 0);
    c.seq = seq;
    hear("SIM/COUNTERS", c);
  }
  EXPECT_THAT(
      text(),
      AllOf(HasSubstr("tether_channel_messages_total{channel=\"SIM/COUNTERS\"} 3\n"),
            HasSubstr("tether_channel_messages_missed_total{channel=\"SIM/COUNTERS\"} 2\n")));
}

TEST_F(MetricsTest, HelpAndTypeComeOnceBeforeTheSamplesOfAName) {
  hear("LINK/REPORT", report("AGV1"));
  hear("LINK/REPORT", report("AGV2"));
  EXPECT_THAT(text(), HasSubstr("# TYPE tether_link_up gauge\ntether_link_up{peer=\"AGV1\"} 0\n"
                                "tether_link_up{peer=\"AGV2\"} 0\n# HELP "));
}

TEST_F(MetricsTest, AHostileNameStaysInsideItsQuotes) {
  hear("SIM/COUNTERS", counters("a\"b\\c\nd\xff", "x", 1));
  EXPECT_THAT(text(), HasSubstr("node=\"a\\\"b\\\\c\\\\x0ad\\\\xff\",event=\"x\"} 1\n"));
}

TEST_F(MetricsTest, TheSameNameTwiceInOneReportIsOneSample) {
  counters_t twice = counters("sim", "x", 1);
  twice.count = 2;
  twice.name.emplace_back("x");
  twice.value.push_back(5);
  hear("SIM/COUNTERS", twice);
  EXPECT_THAT(text(), AllOf(HasSubstr("event=\"x\"} 1\n"), Not(HasSubstr("event=\"x\"} 5\n"))));
}

TEST_F(MetricsTest, ValuesThatAreNoNumbersAreSpeltAsTheFormatWantsThem) {
  drivetrain_state_t state{};
  state.v_mps = -std::numeric_limits<double>::infinity();
  state.omega_radps = std::numeric_limits<double>::quiet_NaN();
  hear("CAN/STATE", state);
  EXPECT_THAT(text(), AllOf(HasSubstr("meters_per_second{vehicle=\"AGV\"} -Inf\n"),
                            HasSubstr("radians_per_second{vehicle=\"AGV\"} NaN\n")));
}

TEST_F(MetricsTest, KeepsABoundedNumberOfChannelsAndReports) {
  for (std::size_t i = 0; i < NetworkMetrics::kMaxChannels + 5; ++i) {
    metrics_.on_message(kStart, "X" + std::to_string(i), {});
  }
  EXPECT_THAT(text(), HasSubstr("tether_metrics_messages_ignored_total 5\n"));
  metrics_ = NetworkMetrics();
  for (std::size_t i = 0; i < NetworkMetrics::kMaxReports + 7; ++i) {
    hear("LINK/REPORT", report("peer" + std::to_string(i)));
  }
  EXPECT_THAT(text(), HasSubstr("tether_metrics_messages_ignored_total 7\n"));
}

TEST_F(MetricsTest, GarbageIsAMessageOfItsChannelAndNothingElse) {
  const auto good = encoded(report("AGV1"));
  for (std::size_t size = 0; size < good.size(); ++size) {
    metrics_.on_message(kStart, "LINK/REPORT", std::span(good).first(size));
  }
  EXPECT_THAT(text(),
              AllOf(HasSubstr("tether_channel_messages_total"), Not(HasSubstr("tether_link_up"))));
}

}  // namespace
}  // namespace tether
