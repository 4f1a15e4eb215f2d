#include "can_bridge/commission/guard.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <optional>
#include <regex>
#include <sstream>

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/cia402/config.hpp"
#include "can_bridge/commission/trials.hpp"
#include "can_bridge/profiles/profiles.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/source_dir.hpp"

namespace tether {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

/// Drives that answer uploads with the value of `serial` for 0x1018:4, else "no such object".
struct Guarded : ::testing::Test {
  Cia402Config config =
      std::get<Cia402Config>(load_drivetrain(in_source("/drivetrains/two_node_cia402.toml")));
  std::map<std::uint8_t, std::uint8_t> serial{{1, 11}, {2, 22}};
  bool answers = true;
  Instant now = kStart;
  std::size_t requests = 0;

  CommissionRecord record() const {
    CommissionRecord record;
    record.vehicle = "AGV";
    record.interface = "can0";
    record.operator_name = "A. Smith";
    record.wheels = "free";
    record.date = "2026-11-27T06:54:19Z";
    record.speed_mps = 0.5;
    record.settings = commissioned_settings(config, 0.4);
    for (std::size_t i = 0; i < 2; ++i) {
      for (const Trial trial : kTrials) {
        record.results.push_back(
            {cia402::axis_name(config, i), trial_name(trial), "as it must be", ""});
      }
    }
    for (const RecordedObject& o : recorded_objects(config)) {
      const bool is_serial = o.index == 0x1018 && o.sub == 4;
      record.objects.push_back(
          {fmt_name(o),
           is_serial ? "0x000000" + std::string(o.node == 1 ? "0B" : "16") : "absent"});
    }
    return record;
  }
  static std::string fmt_name(const RecordedObject& o) {
    return "node " + std::to_string(o.node) + ", " +
           cia402::object_text({o.index, o.sub, 0, false}, o.meaning);
  }
  CommissionGuard guard(std::optional<CommissionRecord> of, const std::string& why = "") const {
    return {config, 0.4, std::move(of), why};
  }
  void answer(CommissionGuard& guard, const CanFrame& request) {
    ASSERT_TRUE(is_upload_request(request));
    ++requests;
    if (!answers) return;
    const auto node = static_cast<std::uint8_t>(request.id - canopen::kSdoRequest);
    const auto& d = request.data;
    const bool is_serial = d[1] == 0x18 && d[2] == 0x10 && d[3] == 4;
    guard.on_frame(is_serial ? CanFrame::make(canopen::kSdoResponse + node,
                                              {0x43, d[1], d[2], d[3], serial[node], 0, 0, 0})
                             : CanFrame::make(canopen::kSdoResponse + node,
                                              {0x80, d[1], d[2], d[3], 0, 0, 0x02, 0x06}));
  }
  void run(CommissionGuard& guard, DrivePhase phase, int cycles = 100) {
    for (int i = 0; i < cycles; ++i, now += std::chrono::milliseconds{20}) {
      std::vector<CanFrame> out;
      guard.tick(now, phase, out);
      for (const CanFrame& frame : out) answer(guard, frame);
    }
  }
};

TEST_F(Guarded, DrivesThatAreAsTheyWereMayBeArmedOnceTheyWereCompared) {
  CommissionGuard g = guard(record());
  EXPECT_THAT(g.refusal(), HasSubstr("being compared"));
  run(g, DrivePhase::starting);
  EXPECT_EQ(requests, 0U);
  EXPECT_THAT(g.refusal(), HasSubstr("being compared"));
  run(g, DrivePhase::standby);
  EXPECT_THAT(g.refusal(), IsEmpty());
}

TEST_F(Guarded, NothingIsAskedWhileTheProfileMayAsk) {
  CommissionGuard g = guard(record());
  for (const DrivePhase phase : {DrivePhase::starting, DrivePhase::refused, DrivePhase::enabling,
                                 DrivePhase::enabled, DrivePhase::stopping, DrivePhase::faulted}) {
    run(g, phase);
  }
  EXPECT_EQ(requests, 0U);
  run(g, DrivePhase::standby);
  const std::size_t once = requests;
  run(g, DrivePhase::standby);
  EXPECT_EQ(requests, once);
}

TEST_F(Guarded, AnotherDriveIsNamed) {
  serial[2] = 23;
  CommissionGuard g = guard(record());
  run(g, DrivePhase::standby);
  EXPECT_THAT(g.refusal(),
              HasSubstr("node 2, 0x1018:4 (serial number) is 0x00000017, was 0x00000016"));
}

TEST_F(Guarded, ADriveThatIsExchangedAfterwardsIsNoticedAfterItsStartUp) {
  CommissionGuard g = guard(record());
  run(g, DrivePhase::standby);
  run(g, DrivePhase::enabled);
  EXPECT_THAT(g.refusal(), IsEmpty());
  run(g, DrivePhase::faulted);
  serial[1] = 12;
  run(g, DrivePhase::starting, 1);
  EXPECT_THAT(g.refusal(), HasSubstr("being compared"));
  run(g, DrivePhase::standby);
  EXPECT_THAT(g.refusal(), HasSubstr("node 1, 0x1018:4"));
}

TEST_F(Guarded, ADriveThatDoesNotAnswerIsNotArmed) {
  answers = false;
  CommissionGuard g = guard(record());
  run(g, DrivePhase::standby, 4000);
  EXPECT_THAT(g.refusal(), StartsWith("node 1 does not answer"));
}

TEST_F(Guarded, WithoutARecordNothingIsAskedAndTheReasonSaysWhy) {
  CommissionGuard g = guard(std::nullopt, "there is no file");
  run(g, DrivePhase::standby);
  EXPECT_EQ(requests, 0U);
  EXPECT_THAT(g.refusal(), StartsWith("not commissioned: there is no file. "));
}

TEST_F(Guarded, ARecordWithProblemsOrWithoutATrialOrOfAnotherFileRefuses) {
  CommissionRecord failed = record();
  failed.results[3].problem = "heartbeat withheld: it drives on";
  EXPECT_THAT(guard(failed).refusal(),
              StartsWith("the commissioning failed: left drive (node 1): heartbeat withheld"));
  CommissionRecord part = record();
  part.results.pop_back();
  EXPECT_THAT(guard(part).refusal(),
              StartsWith("the commissioning is not complete: right drive (node 2): SYNC withheld"));
  CommissionRecord other = record();
  other.settings[3].value = "99";
  CommissionGuard g = guard(other);
  run(g, DrivePhase::standby);
  EXPECT_EQ(requests, 0U);
  EXPECT_THAT(g.refusal(), StartsWith("commissioned with another drivetrain file: "));
}

/// `text` with each of its numbers replaced by each extreme value.
std::vector<std::string> changed_numbers(const std::string& text) {
  static const std::regex kNumber("0x[0-9A-F]+|[0-9]+(\\.[0-9]+)?(e-?[0-9]+)?");
  std::vector<std::string> all;
  for (std::sregex_iterator at(text.begin(), text.end(), kNumber), end; at != end; ++at) {
    for (const char* value : {"0", "-1", "1e308", "-1e308", "1e-308", "nan", "inf", "1e400", ""}) {
      const auto begin = static_cast<std::size_t>(at->position());
      const auto length = static_cast<std::size_t>(at->length());
      all.push_back(std::string(text).replace(begin, length, value));
    }
  }
  return all;
}

TEST_F(Guarded, ARecordWithAnotherNumberAnywhereIsRefusedOrDoesNotArm) {
  const std::string text = to_toml(record());
  std::size_t tried = 0, unread = 0, not_armed = 0;
  for (const std::string& changed : changed_numbers(text)) {
    if (changed == text) continue;
    ++tried;
    std::optional<CommissionRecord> read;
    const std::string refusal = refusal_of([&] { read = parse_record(changed, "record.toml"); });
    if (!read) {
      ++unread;
      EXPECT_THAT(refusal, StartsWith("record.toml:"));
      continue;
    }
    CommissionGuard g = guard(read);
    run(g, DrivePhase::standby);
    if (!g.refusal().empty()) {
      ++not_armed;
      continue;
    }
    // All that drives are compared with is as it was; the date and the speed are for people.
    EXPECT_EQ(read->settings, record().settings) << changed;
    EXPECT_EQ(read->objects, record().objects) << changed;
    EXPECT_TRUE(read->passed());
    EXPECT_EQ(read->speed_mps, 0.5);
  }
  EXPECT_GT(unread, 0U);
  EXPECT_GT(not_armed, 1000U);
  EXPECT_GT(tried, unread + not_armed);
}

TEST_F(Guarded, ARecordWithAKeyTwiceIsRefused) {
  const std::string text = to_toml(record());
  EXPECT_EQ(refusal_of([&] { parse_record(text, "record.toml"); }), "accepted");
  std::istringstream lines(text);
  std::string before;
  for (std::string line; std::getline(lines, line); before += line + "\n") {
    if (line.find(" = ") == std::string::npos) continue;
    const std::string doubled = before + line + "\n" + text.substr(before.size());
    EXPECT_THAT(refusal_of([&] { parse_record(doubled, "record.toml"); }), HasSubstr("record.toml"))
        << line;
  }
}

}  // namespace
}  // namespace tether
