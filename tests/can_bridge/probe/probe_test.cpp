#include "can_bridge/probe/probe.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/emulated/node.hpp"
#include "can_bridge/profiles/profiles.hpp"
#include "tests/support/source_dir.hpp"

namespace tether {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using Verdict = ProbeRow::Verdict;

Duration probe_ms(int milliseconds) { return std::chrono::milliseconds(milliseconds); }
Instant probed_at(int milliseconds) { return kStart + probe_ms(milliseconds); }

// ---------------------------------------------------------------------------- values

std::string shown(ProbeItem::Kind kind, const std::vector<std::uint8_t>& bytes,
                  bool is_signed = false) {
  return probe_value({{0x1000, 0, 0, is_signed}, "", kind, ProbeItem::Need::info, {}}, bytes);
}

TEST(ProbeValue, ReadsAsATechnicianThinks) {
  using Kind = ProbeItem::Kind;
  EXPECT_EQ(shown(Kind::device_type, {0x92, 0x01, 0x02, 0x00}), "0x00020192 (CiA 402 drive)");
  EXPECT_EQ(shown(Kind::device_type, {0x91, 0x01, 0x00, 0x00}), "0x00000191 (profile 401)");
  EXPECT_EQ(shown(Kind::statusword, {0x37, 0x02}), "0x0237 (OperationEnabled)");
  EXPECT_EQ(shown(Kind::supported_modes, {0x05, 0, 0, 0}), "0x00000005 (pp pv)");
  EXPECT_EQ(shown(Kind::supported_modes, {0x09, 0, 0, 0}),
            "0x00000009 (pp tq; no profile velocity!)");
  EXPECT_EQ(shown(Kind::heartbeat_consumer, {0xFA, 0x00, 0x7F, 0x00}),
            "0x007F00FA (node 0x7F, 250 ms)");
  EXPECT_EQ(shown(Kind::heartbeat_consumer, {0, 0, 0x7F, 0}), "0x007F0000 (off)");
  EXPECT_EQ(shown(Kind::milliseconds, {0x64, 0x00}), "100 ms");
  EXPECT_EQ(shown(Kind::milliseconds, {0x00, 0x00}), "0 (off)");
  EXPECT_EQ(shown(Kind::error_code, {0x30, 0x81}), "0x8130");
  EXPECT_EQ(shown(Kind::error_code, {0x00, 0x00}), "0 (none)");
  EXPECT_EQ(shown(Kind::cob_id, {0x01, 0x02, 0x00, 0x80}), "0x201 (off)");
  EXPECT_EQ(shown(Kind::mapping, {0x20, 0x00, 0xFF, 0x60}), "0x60FF:00, 32 bits");
  EXPECT_EQ(shown(Kind::text, {'a', 'b', 7, 0, 'c'}), "\"ab?\"");
  EXPECT_EQ(shown(Kind::number, {0xFE, 0xFF}), "65534");
  EXPECT_EQ(shown(Kind::number, {0xFE, 0xFF}, true), "-2");
}

// ---------------------------------------------------------------------------- the whole

Cia402Config shipped(const std::string& name) {
  return std::get<Cia402Config>(load_drivetrain(in_source("/drivetrains/") + name));
}

/// Runs a probe against emulated drives that have been on for a second; every frame that it sends
/// is checked to be nothing but a reading.
class ProbeRun {
 public:
  ProbeRun(const Cia402Config& drives, const std::vector<std::uint8_t>& nodes,
           const Cia402Config* file)
      : ProbeRun(drives, Probe(nodes, file, probed_at(1000))) {}
  ProbeRun(const Cia402Config& drives, Probe looking)
      : probe(std::move(looking)), emulator_(drives, kStart) {
    for (int t = 0; t < 1000; ++t) emulator_.tick(probed_at(t), dropped_);
  }

  EmulatedCia402& emulator() { return emulator_; }

  void run() {
    for (int t = 1000; t < 60'000 && !probe.done(probed_at(t)); ++t) {
      std::vector<CanFrame> asked, answers;
      probe.tick(probed_at(t), asked);
      EXPECT_LE(asked.size(), 1U) << "an adapter's queue holds few";
      for (const CanFrame& frame : asked) {
        EXPECT_TRUE(is_upload_request(frame));
        emulator_.on_frame(frame, probed_at(t), answers);
      }
      emulator_.tick(probed_at(t), answers);
      for (const CanFrame& frame : answers) {
        const auto filters = Probe::filters();
        if (std::any_of(filters.begin(), filters.end(),
                        [&](const CanFilter& f) { return f.passes(frame); })) {
          probe.on_frame(frame, probed_at(t));
        }
      }
      sent += asked.size();
      ended_ms = t + 1;
    }
    report = probe.report();
    EXPECT_EQ(report.empty(), false);
  }

  const ProbeRow* row(std::size_t node, const std::string& object) const {
    for (const ProbeRow& r : report.at(node).rows) {
      if (r.object == object) return &r;
    }
    return nullptr;
  }

  Probe probe;
  std::vector<ProbedNode> report;
  std::size_t sent = 0;
  int ended_ms = 0;

 private:
  EmulatedCia402 emulator_;
  std::vector<CanFrame> dropped_;
};

TEST(Probe, TellsWhatADriveIsWithoutKnowingIt) {
  const Cia402Config drives = shipped("two_node_cia402.toml");
  ProbeRun run(drives, {1, 2}, nullptr);
  run.run();
  ASSERT_EQ(run.report.size(), 2U);
  EXPECT_TRUE(run.report[1].answered);
  ASSERT_NE(run.row(0, "0x1000:00"), nullptr);
  EXPECT_EQ(run.row(0, "0x1000:00")->value, "0x00020192 (CiA 402 drive)");
  ASSERT_NE(run.row(0, "0x1008:00"), nullptr);
  EXPECT_GT(run.row(0, "0x1008:00")->value.size(), 6U) << "a name, by segmented upload";
  EXPECT_EQ(run.row(0, "0x6041:00")->name, "statusword");
  EXPECT_THAT(run.row(0, "0x6041:00")->value, HasSubstr("SwitchOnDisabled"));
  EXPECT_EQ(run.row(0, "0x1016:01")->value, "0x00000000 (off)");
  EXPECT_EQ(run.row(0, "0x2000:00"), nullptr) << "what is not there and not wanted is not shown";
  for (const ProbeRow& row : run.report[0].rows) EXPECT_EQ(row.verdict, Verdict::plain);
}

TEST(Probe, EveryShippedFileFitsItsOwnEmulatedDrives) {
  for (const char* const name :
       {"two_node_cia402.toml", "dual_axis_cia402.toml", "zlac8015d.toml"}) {
    const Cia402Config file = shipped(name);
    std::vector<std::uint8_t> nodes{file.axes[0].node};
    if (file.axes[1].node != nodes[0]) nodes.push_back(file.axes[1].node);
    ProbeRun run(file, nodes, &file);
    run.run();
    for (const ProbedNode& node : run.report) {
      EXPECT_TRUE(node.fits()) << format_probe(run.report, run.probe.heard(), name);
    }
    EXPECT_THAT(format_probe(run.report, run.probe.heard(), name), HasSubstr("\" fits, as far"));
  }
}

TEST(Probe, ShowsWhatStartUpWillChange) {
  const Cia402Config file = shipped("two_node_cia402.toml");
  ProbeRun run(file, {2}, &file);
  run.run();
  const ProbeRow* const watchdog = run.row(0, "0x1016:01");
  ASSERT_NE(watchdog, nullptr);
  EXPECT_EQ(watchdog->name, "watchdog");
  EXPECT_EQ(watchdog->value, "0x00000000 (off)");
  EXPECT_EQ(watchdog->remark, "start-up sets 0x007F00FA (node 0x7F, 250 ms)");
  EXPECT_EQ(watchdog->verdict, Verdict::note);
  EXPECT_EQ(run.row(0, "0x6007:00")->name, "watchdog's reaction");
  EXPECT_EQ(run.row(0, "0x6007:00")->remark, "start-up sets 3");
  EXPECT_EQ(run.row(0, "0x6083:00")->remark, "start-up sets 14400");
  EXPECT_EQ(run.row(0, "0x60FF:00")->verdict, Verdict::fits);
}

TEST(Probe, AMissingObjectThatTheFileNeedsIsAProblem) {
  const Cia402Config drives = shipped("zlac8015d.toml");
  const Cia402Config file = shipped("dual_axis_cia402.toml");
  ProbeRun run(drives, {1}, &file);
  run.run();
  EXPECT_FALSE(run.report[0].fits());
  const ProbeRow* const watchdog = run.row(0, "0x1016:01");
  ASSERT_NE(watchdog, nullptr);
  EXPECT_EQ(watchdog->verdict, Verdict::problem);
  EXPECT_EQ(watchdog->value, "-");
  EXPECT_EQ(watchdog->remark, "0x06020000 (no such object): the file needs it");
  EXPECT_EQ(run.row(0, "0x1029:01")->verdict, Verdict::note);
  // There, but of another size: 32 bits for both axes.
  EXPECT_EQ(run.row(0, "0x6041:00")->verdict, Verdict::problem);
  EXPECT_EQ(run.row(0, "0x6041:00")->remark, "has 32 bits, the file says 16");
  EXPECT_THAT(format_probe(run.report, {}, "x"), HasSubstr("\"x\" does NOT fit"));
}

TEST(Probe, APresetMappingMustBeTheDrivesOwn) {
  Cia402Config file = shipped("two_node_cia402.toml");
  file.pdos.front().preset = true;  // RPDO1 of node 1
  {
    ProbeRun run(file, {1}, &file);
    run.run();
    EXPECT_TRUE(run.report[0].fits());
    ASSERT_NE(run.row(0, "0x1600:02"), nullptr);
    EXPECT_EQ(run.row(0, "0x1600:02")->value, "0x60FF:00, 32 bits");
  }
  ProbeRun run(shipped("two_node_cia402.toml"), {1}, &file);  // maps the controlword only
  run.run();
  EXPECT_FALSE(run.report[0].fits());
  EXPECT_EQ(run.row(0, "0x1600:00")->verdict, Verdict::problem);
  EXPECT_EQ(run.row(0, "0x1600:00")->remark, "must be 2");
}

TEST(Probe, ANodeThatIsNotThereIsGivenUpSoonAndTheOthersAreStillRead) {
  const Cia402Config drives = shipped("two_node_cia402.toml");
  ProbeRun run(drives, {1, 9}, nullptr);
  run.run();
  EXPECT_TRUE(run.report[0].answered);
  EXPECT_FALSE(run.report[1].answered);
  EXPECT_THAT(run.report[1].rows, IsEmpty());
  // Three objects, each asked for twice with 300 ms to answer.
  EXPECT_LE(run.ended_ms, 1000 + 3 * 2 * 300 + 10);
}

TEST(Probe, AsksANodeAllOverThatBootsMeanwhile) {
  const Cia402Config file = shipped("two_node_cia402.toml");
  for (const int boots_at_ms : {1, 299, 400, 700, 1400}) {
    Probe probe({1, 2}, &file, probed_at(0));
    std::optional<EmulatedCia402> drives;
    for (int t = 0; t < 60'000 && !probe.done(probed_at(t)); ++t) {
      std::vector<CanFrame> asked, answers;
      probe.tick(probed_at(t), asked);
      if (t == boots_at_ms) drives.emplace(file, probed_at(t));
      if (!drives) continue;
      for (const CanFrame& frame : asked) drives->on_frame(frame, probed_at(t), answers);
      drives->tick(probed_at(t), answers);
      for (const CanFrame& frame : answers) probe.on_frame(frame, probed_at(t));
    }
    for (const ProbedNode& node : probe.report()) {
      EXPECT_TRUE(node.fits()) << boots_at_ms;
      EXPECT_EQ(node.rows.at(0).value, "0x00020192 (CiA 402 drive)") << boots_at_ms;
    }
  }
}

TEST(Probe, ListensForHeartbeatsEvenIfAllIsReadSoon) {
  Probe probe({1}, nullptr, kStart);
  std::vector<CanFrame> out;
  for (int i = 0; i < 3; ++i) {  // three aborts would still be answers; none comes
    probe.tick(probed_at(600 * i), out);
    probe.tick(probed_at(600 * i + 300), out);
    probe.tick(probed_at(600 * i + 600), out);
  }
  probe.on_frame(canopen::heartbeat_frame(1, canopen::NmtState::pre_operational), probed_at(1700));
  probe.on_frame(canopen::heartbeat_frame(4, canopen::NmtState::operational), probed_at(1700));
  CanFrame answer;  // to another master
  answer.id = 0x586;
  answer.size = 8;
  answer.data[0] = 0x60;
  probe.on_frame(answer, probed_at(1700));
  probe.tick(probed_at(1900), out);
  ASSERT_TRUE(probe.done(probed_at(1900)));
  EXPECT_EQ(probe.report()[0].nmt, canopen::NmtState::pre_operational);
  EXPECT_EQ(probe.heard(), (std::set<int>{1, 4, 6}));
  EXPECT_EQ(out.size(), 6U);
}

TEST(Probe, IsNotDoneBeforeItHasListenedLongEnough) {
  const Cia402Config drives = shipped("two_node_cia402.toml");
  ProbeRun run(drives, {1}, nullptr);
  run.run();
  EXPECT_GE(run.ended_ms, 1000 + 1500);
}

TEST(ProbeScan, FindsEveryNodeThatAnswersAndNoOther) {
  Cia402Config drives = shipped("two_node_cia402.toml");
  const auto renamed = [](std::uint8_t node) {
    return static_cast<std::uint8_t>(126 * node - 125);
  };
  for (AxisConfig& axis : drives.axes) axis.node = renamed(axis.node);
  for (PdoConfig& pdo : drives.pdos) pdo.node = renamed(pdo.node);
  for (WatchdogConfig& watchdog : drives.watchdogs) watchdog.node = renamed(watchdog.node);
  ProbeRun run(drives, Probe::scan(probed_at(1000)));
  run.run();
  ASSERT_EQ(run.report.size(), 127U);
  for (const ProbedNode& node : run.report) {
    EXPECT_EQ(node.answered, node.node == 1 || node.node == 127) << int{node.node};
  }
  ASSERT_NE(run.row(126, "0x1000:00"), nullptr);
  EXPECT_EQ(run.row(126, "0x1000:00")->value, "0x00020192 (CiA 402 drive)");
  EXPECT_EQ(run.report[126].rows.size(), 3U);
  // One request and a repetition to each of 125 that are not there, six to those that are.
  EXPECT_EQ(run.sent, 125U * 2 + 6);
  EXPECT_LE(run.ended_ms, 1000 + 1510);
}

// ---------------------------------------------------------------------------- text

TEST(ProbeText, HintsDependOnWhatWasHeard) {
  ProbedNode node;
  node.node = 3;
  EXPECT_THAT(format_probe({node}, {}, ""),
              ::testing::AllOf(HasSubstr("node 3: does not answer (no heartbeat)"),
                               HasSubstr("No node was heard on this bus"), HasSubstr("120 Ohm"),
                               HasSubstr("bit rate")));
  EXPECT_THAT(format_probe({node}, {1, 2}, ""),
              ::testing::AllOf(HasSubstr("Heard on this bus: nodes 1, 2. Check the node id"),
                               Not(HasSubstr("120 Ohm"))));
  EXPECT_THAT(format_probe({node}, {}, "x"),
              HasSubstr("\"x\" cannot be compared: a drive is missing"));
  node.nmt = canopen::NmtState::stopped;
  EXPECT_THAT(format_probe({node}, {3}, ""),
              ::testing::AllOf(HasSubstr("(heartbeat: stopped)"), HasSubstr("It lives")));
}

TEST(ProbeText, AScanIsATableOfWhoIsThere) {
  ProbedNode drive, master, absent;
  drive.node = 5;
  drive.answered = true;
  drive.rows = {{"0x1000:00", "device type", "0x00020192 (CiA 402 drive)", "", Verdict::plain},
                {"0x1018:01", "vendor", "0x00000123", "", Verdict::plain},
                {"0x1018:02", "product code", "-", "no such object", Verdict::plain}};
  master.node = 127;
  master.nmt = canopen::NmtState::operational;
  absent.node = 6;
  EXPECT_EQ(format_scan({drive, absent, master}, {127}),
            "node  device type                 vendor      product code\n"
            "   5  0x00020192 (CiA 402 drive)  0x00000123  -             no heartbeat\n"
            " 127  does not answer             -           -             heartbeat: operational; a "
            "master?\n"
            "1 of 127 node ids answers\n");
  EXPECT_THAT(format_scan({absent}, {}),
              ::testing::AllOf(HasSubstr("no node of 1 to 127 answers"), HasSubstr("120 Ohm")));
}

TEST(ProbeText, RowsAreATableWithVerdicts) {
  ProbedNode node;
  node.node = 1;
  node.answered = true;
  node.nmt = canopen::NmtState::operational;
  node.rows = {{"0x1000:00", "device type", "0x00020192", "", Verdict::fits},
               {"0x1016:01", "watchdog", "-", "no such object", Verdict::problem}};
  EXPECT_EQ(format_probe({node}, {1}, "drives"),
            "node 1: answers, heartbeat: operational\n"
            "  0x1000:00  device type  0x00020192  ok\n"
            "  0x1016:01  watchdog     -           PROBLEM  no such object\n"
            "\n\"drives\" does NOT fit: see PROBLEM above\n");
}

}  // namespace
}  // namespace tether
