// Nodes in lockstep give what one process gives, whatever the network does to the protocol and to
// the messages; and what cannot be mended ends the run with an error that names the culprit.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <string>
#include <tether/time_welcome_t.hpp>
#include <vector>

#include "tests/loop/lockstep_rig.hpp"
#include "tests/support/source_dir.hpp"

namespace tether {
namespace {

using test::BadLine;
using test::LineFaults;
using test::LockstepRig;
using test::record_of;
using ::testing::HasSubstr;

Scenario scenario(const std::vector<std::string>& more = {}, const char* file = "paper.toml") {
  std::vector<std::string> overrides{"run.duration_s=4", "vehicle.plant=kinematic",
                                     "sensor.rate_hz=20", "channel.prr=0.8", "channel.delay_ms=30"};
  overrides.insert(overrides.end(), more.begin(), more.end());
  return load_scenario(in_source("/scenarios/") + std::string(file), overrides);
}

void expect_as_in_one_process(const Scenario& s, const LineFaults& faults = {}) {
  LockstepRig rig(s, faults);
  rig.run();
  ASSERT_EQ(rig.manager->error(), "");
  const auto alone = record_of(s);
  EXPECT_EQ(rig.record.messages(), alone.messages());
  EXPECT_TRUE(rig.record == alone);
}

TEST(Lockstep, GivesWhatOneProcessGives) {
  expect_as_in_one_process(scenario());
  expect_as_in_one_process(scenario({"vehicle.plant=ode", "run.seed=5", "run.duration_s=1"}));
  expect_as_in_one_process(scenario(
      {"vehicle.start_error_m=0.2", "vehicle.start_error_rad=0.1", "sensor.odometry_rate_hz=25"}));
}

TEST(Lockstep, WithTiesBetweenTheNodes) {
  // Timers of different periods that meet, and messages that arrive at the instant they were sent.
  for (const char* rate : {"10", "20", "40"}) {
    expect_as_in_one_process(
        scenario({"channel.delay_ms=0", "controller.trigger=timer",
                  "controller.rate_hz=" + std::string(rate), "run.report_period_s=0.1"}));
  }
  expect_as_in_one_process(scenario({"channel.delay_ms=50", "sensor.latency_ms=50"}));
}

TEST(Lockstep, WithPlansALeadAndAChannelThatChanges) {
  expect_as_in_one_process(scenario({"controller.law=predictive", "actuator.policy=horizon",
                                     "controller.preload=true", "run.lead_s=1"}));
  expect_as_in_one_process(load_scenario(in_source("/scenarios/paper_markov.toml"),
                                         {"run.duration_s=4", "vehicle.plant=kinematic"}));
  expect_as_in_one_process(scenario({"channel.uplink.duplicate.probability=0.3",
                                     "channel.change=[{at_s=1, "
                                     "set=['uplink.prr=0.5']}]"}));
}

TEST(Lockstep, OverANetworkThatLosesDoublesAndDelays) {
  const LineFaults faults{.lost = 0.05, .doubled = 0.05, .delayed = 0.05};
  expect_as_in_one_process(scenario({"channel.uplink.duplicate.probability=0.3"}), faults);
}

TEST(Lockstep, SimulatorIsGrantedTimeUpToTheNextForeignEvent) {
  LockstepRig rig(scenario({"sensor.rate_hz=1", "run.report_period_s=4"}));
  rig.run();
  EXPECT_LT(rig.manager->counters().grants, 100);  // not one for each of 4000 steps
}

struct Fault {
  std::string error;
  double wall_s;
};

/// The run's error, and how long after the fault it came.
Fault after(LockstepRig& rig, const std::function<void()>& fault,
            Instant when = kStart + from_seconds(1)) {
  rig.run_to(when);
  EXPECT_EQ(rig.manager->error(), "");
  const Instant before = rig.wall.now();
  fault();
  rig.run(100.0);
  EXPECT_FALSE(rig.manager->done());
  return {rig.manager->error(), to_seconds(rig.wall.now() - before)};
}

TEST(LockstepFaults, ANodeThatFallsSilentIsNamedWithWhatItOwes) {
  LockstepRig rig(scenario());
  const Fault fault =
      after(rig, [&] { rig.line(1).faults.swallow = [](const Message&) { return true; }; });
  EXPECT_THAT(fault.error, ::testing::StartsWith("netem did not answer within 10.0 s: it owes the "
                                                 "answer to grant "));
  EXPECT_LT(fault.wall_s, 10.5);
}

TEST(LockstepFaults, ANodeThatNeverJoinsIsNamed) {
  LockstepRig rig(scenario());
  rig.line(2).faults.swallow = [](const Message&) { return true; };
  rig.run();
  EXPECT_EQ(rig.manager->error(), "controller did not join within 20 s");
}

TEST(LockstepFaults, ANodeThatJoinsTwiceOrLateIsNamed) {
  LockstepRig twice(scenario());
  twice.join("sim", 2);
  twice.run();
  EXPECT_THAT(twice.manager->error(), ::testing::StartsWith("sim joined twice"));
  EXPECT_THAT(twice.manager->error(), HasSubstr("as instances 1 and 2"));

  LockstepRig late(scenario());
  const Fault fault = after(late, [&] { late.join("netem", 2); });
  EXPECT_THAT(fault.error, HasSubstr("netem joined twice, the second time late"));
  EXPECT_LT(fault.wall_s, 0.5);
}

TEST(LockstepFaults, AnUnknownSenderThatJoinsIsNamed) {
  LockstepRig rig(scenario());
  const Fault fault = after(rig, [&] {
    time_join_t join{};
    join.session = LockstepRig::kSession;
    join.node = "camera";
    publish(rig.unknown_sender(), kTimeJoin, join);
  });
  EXPECT_EQ(fault.error, "a node \"camera\" joined late; this run has sim, netem, controller");
}

/// A program that has heard what the coordinator says to the nodes, keys included.
class Listener {
 public:
  explicit Listener(LockstepRig& rig) : rig_(rig) {
    rig.unknown_sender().subscribe(kTimeWelcome, kDeepQueue, [this](const Message& m) {
      time_welcome_t welcome{};
      if (decode(m.bytes, welcome) && !welcome.node.empty()) keys_[welcome.node] = welcome.node_key;
    });
  }
  template <class LcmType>
  LcmType with_key(LcmType message) const {
    message.mac = mac_of(message, key_of_hex(keys_.at(message.node)).value());
    return message;
  }
  /// Calls `forge` at the first grant to `node` after this, and publishes what it makes of it.
  template <class Forge>
  void at_next_grant(const std::string& node, const std::string& channel, Forge forge) {
    rig_.unknown_sender().subscribe(kTimeGrant, kDeepQueue,
                                    [=, this, done = false](const Message& m) mutable {
                                      time_grant_t grant{};
                                      if (done || !decode(m.bytes, grant) || grant.node != node ||
                                          grant.kind != time_grant_t::RUN) {
                                        return;
                                      }
                                      done = true;
                                      publish(rig_.unknown_sender(), channel, forge(grant));
                                    });
  }

 private:
  LockstepRig& rig_;
  std::map<std::string, std::string> keys_;
};

time_request_t request(std::int64_t grant) {
  time_request_t r{};
  r.session = LockstepRig::kSession;
  r.instance = 1;
  r.node = "controller";
  r.grant = grant;
  return r;
}

TEST(LockstepFaults, AnAnswerToTheWrongGrantIsAnError) {
  LockstepRig rig(scenario());
  const Listener listener(rig);
  const Fault fault = after(
      rig, [&] { publish(rig.unknown_sender(), kTimeRequest, listener.with_key(request(9999))); });
  EXPECT_THAT(fault.error, HasSubstr("controller answered grant 9999, but"));
}

/// Attempts of an unknown sender with and without the keys that it can hear.
template <class Forge>
void expect_no_wrong_result(const std::string& channel, const Forge& forge,
                            const std::string& error) {
  const Scenario s = scenario({"channel.prr=1"});
  for (const bool knows_key : {false, true}) {
    LockstepRig rig(s);
    Listener listener(rig);
    rig.run_to(kStart + from_seconds(1));
    listener.at_next_grant("controller", channel, [&](const time_grant_t& grant) {
      auto message = forge(grant);
      return knows_key ? listener.with_key(message) : message;
    });
    rig.run();
    if (knows_key) {
      EXPECT_THAT(rig.manager->error(), HasSubstr(error));
      EXPECT_TRUE(rig.manager->disturbed());
    } else {
      EXPECT_TRUE(rig.manager->done()) << rig.manager->error();
      EXPECT_TRUE(rig.record == record_of(s));
      EXPECT_EQ(rig.manager->counters().forged, channel == kTimeRequest ? 1 : 0);
    }
  }
}

TEST(LockstepFaults, AForgedAnswerHasNoEffectOrEndsTheRun) {
  const auto silent = [](const time_grant_t& grant) {
    time_request_t answer = request(grant.id);
    answer.grant_mac = grant.mac;
    answer.next_ns = answer.next_order = INT64_MAX;
    return answer;
  };
  expect_no_wrong_result(kTimeRequest, silent, "twice, and differently: another program");
}

TEST(LockstepFaults, AForgedAnswerOfAnotherInstanceHasNoEffectEither) {
  const Scenario s = scenario({"channel.prr=1"});
  LockstepRig rig(s);
  Listener listener(rig);
  rig.run_to(kStart + from_seconds(1));
  listener.at_next_grant("controller", kTimeRequest, [](const time_grant_t& grant) {
    time_request_t answer = request(grant.id);
    answer.instance = 77;
    return answer;
  });
  rig.run();
  EXPECT_TRUE(rig.manager->done()) << rig.manager->error();
  EXPECT_TRUE(rig.record == record_of(s));
  EXPECT_EQ(rig.manager->counters().forged, 1);
}

TEST(LockstepFaults, AForgedGrantHasNoEffectOrEndsTheRun) {
  const auto early = [](time_grant_t grant) {  // the next, before the coordinator's
    ++grant.id;
    grant.count = 0;
    for (auto* texts : {&grant.publisher, &grant.channel, &grant.digest}) texts->clear();
    for (auto* numbers : {&grant.number, &grant.time_ns, &grant.order, &grant.size}) {
      numbers->clear();
    }
    return grant;
  };
  const Scenario s = scenario({"channel.prr=1"});
  for (const bool knows_key : {false, true}) {
    LockstepRig rig(s);
    Listener listener(rig);
    rig.run_to(kStart + from_seconds(1));
    listener.at_next_grant("controller", kTimeGrant, [&](const time_grant_t& grant) {
      return knows_key ? listener.with_key(early(grant)) : early(grant);
    });
    rig.run();
    if (knows_key) {
      EXPECT_THAT(rig.manager->error(), HasSubstr("controller answer"));
    } else {
      EXPECT_TRUE(rig.manager->done()) << rig.manager->error();
      EXPECT_TRUE(rig.record == record_of(s));
    }
  }
}

TEST(LockstepFaults, AGrantForgedInPlaceOfTheCoordinatorsEndsTheRun) {
  LockstepRig rig(scenario({"channel.prr=1"}));
  Listener listener(rig);
  rig.run_to(kStart + from_seconds(1));
  rig.manager_line().faults.swallow = [&, done = false](const Message& m) mutable {
    time_grant_t grant{};
    if (done || m.channel != kTimeGrant || !decode(m.bytes, grant) || grant.node != "sim" ||
        grant.kind != time_grant_t::RUN) {
      return false;
    }
    done = true;
    grant.until_ns += 1;
    publish(rig.unknown_sender(), kTimeGrant, listener.with_key(grant));
    return true;
  };
  rig.run();
  EXPECT_THAT(rig.manager->error(),
              ::testing::MatchesRegex("sim answered a grant [0-9]+ that is not the coordinator's: "
                                      "another program takes part on this run's network"));
}

TEST(LockstepFaults, AnAnswerOfAnotherRunIsCountedAndLeft) {
  LockstepRig rig(scenario());
  rig.run_to(kStart + from_seconds(1));
  time_request_t other = request(9999);
  other.session = 5;
  publish(rig.unknown_sender(), kTimeRequest, other);
  rig.unknown_sender().publish(kTimeRequest, std::vector<std::uint8_t>{1, 2, 3});
  rig.run();
  EXPECT_TRUE(rig.manager->done());
  EXPECT_EQ(rig.manager->counters().foreign, 2);
}

TEST(LockstepFaults, AMessageThatIsLostForGoodIsNamedAndHowToMendIt) {
  LockstepRig rig(scenario({"channel.prr=1"}));
  const Fault fault = after(rig, [&] {
    rig.line(1).faults.swallow = [](const Message& m) { return m.channel == "CTRL/POSE"; };
  });
  EXPECT_THAT(fault.error, HasSubstr("controller could not carry out grant"));
  EXPECT_THAT(fault.error, HasSubstr("of netem on CTRL/POSE (72 bytes) has not come within 5.0 s"));
  EXPECT_THAT(fault.error, HasSubstr("net.core.rmem_max"));
  EXPECT_LT(fault.wall_s, 6.0);
}

TEST(LockstepFaults, AMessageThatIsLostIsNamedHoweverShortTheCoordinatorsPatience) {
  LockstepRig rig(scenario({"channel.prr=1"}), {}, std::chrono::seconds{1});
  const Fault fault = after(rig, [&] {
    rig.line(2).faults.deaf_to = [](const Message& m) { return m.channel == "CTRL/POSE"; };
  });
  EXPECT_THAT(fault.error,
              ::testing::StartsWith("controller did not answer within 1.0 s: message "));
  EXPECT_THAT(fault.error, HasSubstr(" of netem on CTRL/POSE ("));
  EXPECT_THAT(fault.error, HasSubstr("recv_buf_size"));
}

TEST(LockstepFaults, ANodeThatNeverLetsTimeGoOnIsNamed) {
  LockstepRig rig(scenario({"controller.external=true"}));
  const Listener listener(rig);
  time_join_t join{};
  join.session = LockstepRig::kSession;
  join.instance = 1;
  join.node = "controller";
  rig.unknown_sender().subscribe(kTimeGrant, kDeepQueue, [&](const Message& m) {
    time_grant_t grant{};
    if (!decode(m.bytes, grant) || grant.node != "controller") return;
    time_request_t answer = request(grant.id);  // its next event is at 0, now and ever
    answer.next_order = (std::int64_t{2} << 56) + (grant.id << 24);
    answer.grant_mac = grant.mac;
    publish(rig.unknown_sender(), kTimeRequest, listener.with_key(answer));
  });
  publish(rig.unknown_sender(), kTimeJoin, join);
  rig.run(60.0);
  EXPECT_EQ(rig.manager->error(),
            "time does not go on from t = 0.000000 s: after 100000 grants controller still has an "
            "event");
}

TEST(LockstepFaults, AMessageThatOnlyTheRecordMissesIsAnErrorToo) {
  LockstepRig rig(scenario());
  const Fault fault = after(rig, [&] {
    rig.line(0).faults.swallow = [](const Message& m) { return m.channel == "SIM/TRUTH"; };
  });
  EXPECT_THAT(fault.error, HasSubstr("of sim on SIM/TRUTH"));
  EXPECT_THAT(fault.error, HasSubstr("lost on its way to the coordinator"));
}

TEST(LockstepFaults, AnotherMessageInPlaceOfTheRightOneIsNotTakenAndEndsTheRun) {
  const Scenario s = scenario({"channel.prr=1"});
  LockstepRig rig(s);
  rig.run_to(kStart + from_seconds(1));
  rig.unknown_sender().publish("CTRL/POSE", std::vector<std::uint8_t>(72, 7));
  rig.unknown_sender().publish("MY/NOTES", std::vector<std::uint8_t>(48, 7));
  rig.run();
  EXPECT_EQ(rig.manager->error(),
            "1 message on CTRL/POSE (the first of 72 bytes) is no node's: another program takes "
            "part on this run's network");
  EXPECT_TRUE(rig.record == record_of(s));
}

TEST(LockstepFaults, AMessageOnAChannelThatNoNodeReceivesIsLeft) {
  LockstepRig rig(scenario());
  rig.run_to(kStart + from_seconds(1));
  rig.unknown_sender().publish("MY/NOTES", std::vector<std::uint8_t>(48, 7));
  rig.run();
  EXPECT_TRUE(rig.manager->done()) << rig.manager->error();
  EXPECT_EQ(rig.manager->unaccounted().at("MY/NOTES"), 1U);
}

TEST(LockstepFaults, AProcessThatEndsIsNamedAtOnce) {
  LockstepRig rig(scenario());
  const Fault fault =
      after(rig, [&] { rig.manager->on_node_gone("netem", "was killed by signal 9"); });
  EXPECT_THAT(fault.error, ::testing::StartsWith("netem was killed by signal 9"));
  EXPECT_LT(fault.wall_s, 0.001);
}

/// The coordinator falls silent: `still_there_s` later all nodes wait, after 30 s they have ended.
void expect_to_end_in_silence(LockstepRig& rig, double still_there_s) {
  rig.manager_line().faults.swallow = [](const Message&) { return true; };
  const Instant silent = rig.wall.now();
  rig.wall.run_until(silent + from_seconds(still_there_s));
  for (std::size_t node = 0; node < 3; ++node) EXPECT_EQ(rig.member(node).error(), "") << node;
  for (std::size_t node = 0; node < 3; ++node) {
    rig.wall.run_until(silent +
                       from_seconds(30.2));  // a node that ends stops the loop that all share
  }
  for (std::size_t node = 0; node < 3; ++node) {
    EXPECT_EQ(rig.member(node).error(), "the coordinator has been silent for 30 s") << node;
  }
}

TEST(LockstepFaults, NodesOfASilentCoordinatorEndAfterThirtySeconds) {
  LockstepRig rig(scenario());
  rig.run_to(kStart + from_seconds(1));
  expect_to_end_in_silence(rig, 29.9);
}

TEST(LockstepFaults, NodesThatHaveHeardOfACoordinatorAndNeverMetItEndAfterThirtySeconds) {
  LockstepRig rig(scenario());
  rig.manager_line().faults.swallow = [](const Message& m) { return m.channel == "TIME/JOIN"; };
  rig.wall.run_until(rig.wall.now() + from_seconds(5));
  expect_to_end_in_silence(rig, 27.9);
}

TEST(Lockstep, AHeldRunStandsStillAndGoesOnAsIfNothingHadBeen) {
  const Scenario s = scenario();
  LockstepRig rig(s);
  rig.manager->hold(kStart + from_seconds(1));
  rig.run(60.0);
  EXPECT_TRUE(rig.manager->held());
  const auto grants = rig.manager->counters().grants;
  rig.run(60.0);
  EXPECT_EQ(rig.manager->counters().grants, grants);
  for (int i = 0; i < 20; ++i) {
    rig.manager->step();
    rig.run(1.0);
    EXPECT_EQ(rig.manager->counters().grants, grants + 1 + i);
  }
  rig.manager->hold(Instant::max());
  rig.run();
  EXPECT_TRUE(rig.manager->done()) << rig.manager->error();
  EXPECT_TRUE(rig.record == record_of(s));
}

TEST(GrantSchedule, RefusesChannelsOfOtherNodesAndThoseThatReachThem) {
  const Scenario s = scenario();
  const auto error = [&](const std::string& channel, const std::string& node) -> std::string {
    GrantSchedule schedule(kStart + from_seconds(10), channel_owners({s}));
    schedule.add_node(node, {}, {kStart + from_seconds(1), 0, 0});
    schedule.add_node("other", {"AGV/.*"}, {kStart + from_seconds(2), 0, 1});
    const auto grant = schedule.next();
    try {
      schedule.answer(kFirstGrant, *grant, {},
                      {{.channel = channel, .number = 1, .when = kStart + from_seconds(1.5)}});
    } catch (const BadAnswer& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_EQ(error("CTRL/CMD_VEL", "controller"), "");
  EXPECT_EQ(error("MY/NOTES", "controller"), "");
  EXPECT_EQ(error("SIM/TRUTH", "sim"), "");
  EXPECT_EQ(error("SIM/TRUTH", "controller"), "published on SIM/TRUTH, which belongs to sim");
  EXPECT_EQ(error("AGV/CMD_VEL", "controller"), "published on AGV/CMD_VEL, which belongs to netem");
  EXPECT_EQ(error("NET/SET", "controller"), "published on NET/SET, which belongs to netem");
  EXPECT_EQ(error("AGV/DRIVE", "controller"), "published on AGV/DRIVE, which belongs to autonomy");
  EXPECT_EQ(error("CTRL/CMD_VEL", "sim"), "published on CTRL/CMD_VEL, which belongs to controller");
  EXPECT_EQ(error("AGV/OTHER", "controller"),
            "published on AGV/OTHER, which other receives and no node of this run owns");
}

TEST(ChannelOwners, OfPosesIsTheLocaliserWhereThereIsOne) {
  const auto owners = [](const char* place) {
    Scenario s = scenario();
    s.get<LocaliserSettings>().place = place == std::string("edge")
                                           ? LocaliserSettings::Place::edge
                                           : LocaliserSettings::Place::vehicle;
    return channel_owners({s});
  };
  EXPECT_EQ(owners("edge").at("CTRL/POSE"), "localiser");
  EXPECT_EQ(owners("edge").at("AGV/POSE"), "sim");
  EXPECT_EQ(owners("vehicle").at("AGV/POSE"), "localiser");
  EXPECT_EQ(owners("vehicle").at("CTRL/POSE"), "netem");
}

TEST(GrantSchedule, RefusesWhatContradictsAGrant) {
  const auto error = [](const Publication& p, const EventKey& next) -> std::string {
    GrantSchedule schedule(kStart + from_seconds(10));
    schedule.add_node("a", {}, {kStart + from_seconds(1), 0, 0});
    schedule.add_node("b", {"X"}, {kStart + from_seconds(2), 0, 1});
    const auto grant = schedule.next();
    EXPECT_EQ(grant->node, 0U);
    try {
      schedule.answer(kFirstGrant, *grant, next, {p});
    } catch (const BadAnswer& e) {
      return e.what();
    }
    return "";
  };
  const auto at = [](double s) { return kStart + from_seconds(s); };
  const Publication good{.channel = "X", .number = 1, .when = at(1.5)};
  EXPECT_EQ(error(good, {}), "");
  auto p = good;
  p.when = at(0.5);
  EXPECT_EQ(error(p, {}),
            "published on X at t = 0.500000 s, in its past: it was at t = 1.000000 s");
  p.when = at(2.5);
  EXPECT_THAT(error(p, {}), HasSubstr("beyond its grant until t = 2.000000 s"));
  p = good;
  p.number = 3;
  EXPECT_EQ(error(p, {}), "named message 3 on X where number 1 was due");
  p = good;
  p.channel = "TIME/GRANT";
  EXPECT_THAT(error(p, {}), HasSubstr("no channel for it"));
  EXPECT_THAT(error(good, {at(1.2), 0, 0}), HasSubstr("asked for an event at t = 1.200000 s, in"));
}

}  // namespace
}  // namespace tether
