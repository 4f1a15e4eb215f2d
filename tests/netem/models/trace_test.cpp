#include "netem/models/trace.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <sstream>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "netem/models/trace_process.hpp"
#include "tests/support/refusal.hpp"

namespace tether {
namespace {

using std::chrono::milliseconds;

Instant at_ms(double ms) { return kStart + from_seconds(ms * 1e-3); }

Trace trace(const std::string& text) {
  std::istringstream in(text);
  return read_trace(in, "t.csv");
}
std::shared_ptr<const Trace> shared(const std::string& text) {
  return std::make_shared<const Trace>(trace(text));
}

std::string refusal(const std::string& text) {
  return refusal_of([&] { trace(text); });
}

const char* const kThreeRows =
    "# recorded on a Tuesday\n"
    "time_s, delay_ms, prr\n"
    "10.0,   20,       1.0\n"
    "\n"
    "10.1,   40,       0.5\n"
    "10.3,   0,        0.0\n";

LinkCondition condition(double prr, double delay_ms) {
  return {prr, from_seconds(delay_ms * 1e-3)};
}

LinkCondition at(TraceProcess& process, double ms) {
  process.advance(at_ms(ms));
  return process.condition();
}

TraceConfig config(TraceConfig::Interpolation interpolation, TraceConfig::AtEnd at_end) {
  TraceConfig c;
  c.interpolation = interpolation;
  c.at_end = at_end;
  return c;
}
const TraceConfig kStep = config(TraceConfig::Interpolation::step, TraceConfig::AtEnd::hold);
const TraceConfig kStepLoop = config(TraceConfig::Interpolation::step, TraceConfig::AtEnd::loop);
const TraceConfig kLinear = config(TraceConfig::Interpolation::linear, TraceConfig::AtEnd::hold);

// ---------------------------------------------------------------------------- file

TEST(ReadTrace, TakesColumnsInAnyOrderAndIgnoresOthers) {
  const Trace t = trace("prr,what,time_s\r\n0.25,x,-1\r\n1,y,2.5\r\n");
  ASSERT_EQ(t.rows.size(), 2U);
  EXPECT_EQ(t.first_s, -1.0);
  EXPECT_EQ(t.rows[1].since_first, milliseconds{3500});
  EXPECT_EQ(t.rows[0].prr, 0.25);
  EXPECT_EQ(t.rows[0].delay, Duration{0});
}

TEST(ReadTrace, TakesAByteOrderMarkAndQuotes) {
  const Trace t = trace("\xef\xbb\xbf\"time_s\", \"prr\"\r\n0,\"0.25\"\r\n\"1\",1\r\n");
  ASSERT_EQ(t.rows.size(), 2U);
  EXPECT_EQ(t.rows[0].prr, 0.25);
  EXPECT_EQ(refusal("time_s,prr\n0,\"\n"), "t.csv:2: prr = \"\"\" must be a finite number");
}

TEST(ReadTrace, LostPacketsNeedNoDelay) {
  const Trace t = trace("time_s,lost,delay_ms\n0,0,5\n1,1,\n2,0,7\n");
  EXPECT_TRUE(t.of_fates);
  EXPECT_EQ(t.rows[1].prr, 0.0);
  EXPECT_EQ(t.rows[2].delay, milliseconds{7});
}

TEST(ReadTrace, RowsWithoutADelayGetOneBetweenTheirNeighbours) {
  const auto delays_ms = [](const std::string& text) {
    std::vector<double> all;
    for (const Trace::Row& row : trace(text).rows) all.push_back(1e3 * to_seconds(row.delay));
    return all;
  };
  using Delays = std::vector<double>;
  EXPECT_EQ(delays_ms("time_s,delay_ms,lost\n0,50,0\n1,50,0\n2,,1\n3,50,0\n"),
            (Delays{50, 50, 50, 50}));
  EXPECT_EQ(delays_ms("time_s,delay_ms,prr\n0,10,1\n1,,0\n3,,0\n4,50,0.5\n5,0,0\n6,20,1\n"),
            (Delays{10, 20, 40, 50, 0, 20}));
  EXPECT_EQ(delays_ms("time_s,delay_ms,lost\n0,,1\n1,,1\n2,30,0\n3,40,0\n4,,1\n5,,1\n"),
            (Delays{30, 30, 30, 40, 40, 40}));
  EXPECT_EQ(delays_ms("time_s,delay_ms,lost\n0,,1\n1,,1\n"), (Delays{0, 0}));
}

TEST(ReadTrace, RefusesWithFileAndLine) {
  const std::vector<std::pair<std::string, std::string>> cases{
      {"", "t.csv:1: no header line"},
      {"time_s,prr\n", "t.csv:1: no rows below the header"},
      {"t,prr\n0,1\n",
       "t.csv:1: the header must name a column time_s (tether netem import makes a trace of other "
       "tables)"},
      {"time_s,x\n0,1\n",
       "t.csv:1: the header must name one of the columns delay_ms, prr and lost"},
      {"time_s,prr,lost\n0,1,0\n", "t.csv:1: the header names both prr and lost; keep one of them"},
      {"time_s,prr,prr\n0,1,1\n", "t.csv:1: two columns \"prr\""},
      {"time_s,prr\n0,1\n#\n1,1,3\n", "t.csv:4: 3 cells, but the header has 2"},
      {"time_s,prr\n0,1\n1,1.5\n", "t.csv:3: prr = \"1.5\" must be in [0, 1]"},
      {"time_s,prr\n0,nan\n", "t.csv:2: prr = \"nan\" must be a finite number"},
      {"time_s,prr\n0,\n", "t.csv:2: prr = \"\" must be a finite number"},
      {"time_s,delay_ms\n0,-1\n", "t.csv:2: delay_ms = \"-1\" must be in [0, 1e9]"},
      {"time_s,lost\n0,2\n", "t.csv:2: lost = \"2\" must be 0 or 1"},
      {"time_s,lost,delay_ms\n0,0,\n", "t.csv:2: delay_ms = \"\" must be a finite number"},
      {"time_s,prr\n1,1\n1,1\n",
       "t.csv:3: time_s = \"1\" must be later than the row's before, by 1 ns at least"},
      {"time_s,prr\n0,1\n1e300,1\n",
       "t.csv:3: time_s = \"1e300\" must be within 1e9 s of the first row's"}};
  for (const auto& [text, message] : cases) EXPECT_EQ(refusal(text), message);
}

TEST(ReadTrace, NamesAFileThatCannotBeOpened) {
  EXPECT_THROW(load_trace("/nowhere/t.csv"), UsageError);
  EXPECT_THROW(load_trace("/tmp"), UsageError);
}

// ---------------------------------------------------------------------------- stepwise

TEST(TraceProcess, ARowHoldsFromItsTimeToTheNextsToTheNanosecond) {
  TraceProcess p(shared(kThreeRows), kStep, "");
  EXPECT_EQ(at(p, 0), condition(1.0, 20));
  EXPECT_EQ(p.next_transition(), at_ms(100));
  p.advance(at_ms(100) - Duration{1});
  EXPECT_EQ(p.condition(), condition(1.0, 20));
  EXPECT_EQ(at(p, 100), condition(0.5, 40));
  EXPECT_EQ(p.state(), 1);
  EXPECT_EQ(p.next_transition(), at_ms(300));
}

TEST(TraceProcess, HoldsTheFirstRowBeforeAndTheLastAfter) {
  TraceProcess p(shared(kThreeRows), kStep, "");
  p.advance(at_ms(-500));
  EXPECT_EQ(p.condition(), condition(1.0, 20));
  EXPECT_EQ(p.next_transition(), kStart);  // where the first row begins
  EXPECT_EQ(at(p, 1e6), condition(0.0, 0));
  EXPECT_EQ(p.next_transition(), Instant::max());
}

TEST(TraceProcess, StartsWhereToldTo) {
  TraceConfig late = kStep;
  late.start_s = 10.05;
  TraceProcess p(shared(kThreeRows), late, "");
  EXPECT_EQ(at(p, 49), condition(1.0, 20));
  EXPECT_EQ(at(p, 50), condition(0.5, 40));
  late.start_s = -3.9e9;
  EXPECT_NO_THROW(TraceProcess(shared(kThreeRows), late, ""));
  EXPECT_THROW(TraceProcess(shared("time_s,prr\n1e9,1\n"), late, ""), UsageError);
}

TEST(TraceProcess, ALoopPlaysItsLastRowAsLongAsTheOneBefore) {
  TraceProcess p(shared(kThreeRows), kStepLoop, "");
  EXPECT_EQ(at(p, 299), condition(0.5, 40));
  EXPECT_EQ(p.next_transition(), at_ms(300));
  EXPECT_EQ(at(p, 300), condition(0.0, 0));
  EXPECT_EQ(p.next_transition(), at_ms(500));
  p.advance(at_ms(500) - Duration{1});
  EXPECT_EQ(p.condition(), condition(0.0, 0));
  EXPECT_EQ(at(p, 500), condition(1.0, 20));
  EXPECT_EQ(p.next_transition(), at_ms(600));
  EXPECT_EQ(at(p, 500 * 1000 + 250), condition(0.5, 40));
  TraceProcess before(shared(kThreeRows), kStepLoop, "");
  EXPECT_EQ(at(before, -100), condition(0.0, 0));  // same as if it had been running already
  EXPECT_EQ(before.next_transition(), kStart);
}

TEST(TraceProcess, ALoopPlaysEachRowOfASecondForASecond) {
  TraceProcess p(shared("time_s,delay_ms,prr\n0,10,1\n1,10,1\n2,10,0\n"), kStepLoop, "");
  int lost = 0;
  for (int ms = 0; ms < 30'000; ms += 100) lost += at(p, ms).prr == 0.0 ? 1 : 0;
  EXPECT_EQ(lost, 100);
}

TEST(TraceProcess, ALinearLoopMovesFromItsLastRowToItsFirst) {
  TraceConfig loop = kLinear;
  loop.at_end = TraceConfig::AtEnd::loop;
  TraceProcess p(shared(kThreeRows), loop, "");
  EXPECT_EQ(at(p, 200), condition(0.25, 20));
  EXPECT_EQ(at(p, 300), condition(0.0, 0));
  EXPECT_EQ(at(p, 400), condition(0.5, 10));
  EXPECT_EQ(at(p, 500), condition(1.0, 20));
}

TEST(TraceProcess, ALoopOfOneRowIsRefused) {
  try {
    TraceProcess(shared("time_s,prr\n0,1\n"), kStepLoop, "channel.uplink.trace.");
    FAIL();
  } catch (const UsageError& e) {
    EXPECT_STREQ(e.what(),
                 "channel.uplink.trace.at_end = \"loop\" needs a trace of two rows or more");
  }
}

TEST(TraceProcess, DoesNotDependOnHowOftenItIsAsked) {
  std::string text = "time_s,prr\n";
  for (int i = 0; i < 200; ++i)
    text += std::to_string(0.013 * i) + "," + std::to_string(i / 200.0) + "\n";
  TraceProcess often(shared(text), kStepLoop, ""), seldom(shared(text), kStepLoop, "");
  for (int ms = 0; ms < 10000; ++ms) {
    often.advance(at_ms(ms));
    if (ms % 377 != 0) continue;
    EXPECT_EQ(often.condition(), at(seldom, ms)) << ms;
  }
}

TEST(TraceProcess, TimeNeverGoesBack) {
  TraceProcess p(shared(kThreeRows), kStep, "");
  at(p, 200);
  EXPECT_EQ(at(p, 10), condition(0.5, 40));
}

TEST(TraceProcess, ReplaysARecordedLogPacketByPacket) {
  TraceProcess p(shared("time_s,lost\n0,0\n0.05,1\n0.10,1\n0.15,0\n0.20,1\n"), kStep, "");
  std::vector<double> prr;
  for (int i = 0; i < 5; ++i) prr.push_back(p.on_packet(at_ms(50.0 * i)).prr);
  EXPECT_EQ(prr, (std::vector<double>{1, 0, 0, 1, 0}));
}

// ---------------------------------------------------------------------------- linear

TEST(TraceProcess, LinearMovesEvenlyBetweenRows) {
  TraceProcess p(shared(kThreeRows), kLinear, "");
  EXPECT_EQ(at(p, 0), condition(1.0, 20));
  EXPECT_EQ(at(p, 25).delay, milliseconds{25});
  EXPECT_DOUBLE_EQ(p.condition().prr, 0.875);
  EXPECT_DOUBLE_EQ(at(p, 200).prr, 0.25);
  EXPECT_EQ(p.condition().delay, milliseconds{20});
  EXPECT_EQ(p.next_transition(), Instant::max());
  EXPECT_EQ(at(p, 5000), condition(0.0, 0));
}

TEST(TraceProcess, LinearInterpolatesNoFates) {
  TraceProcess p(shared("time_s,lost,delay_ms\n0,0,10\n1,1,20\n2,0,30\n"), kLinear, "");
  EXPECT_EQ(at(p, 500), condition(1.0, 15));
  EXPECT_EQ(at(p, 1500).prr, 0.0);
}

TEST(TraceProcess, LinearInventsNoDelayWhereNothingArrived) {
  TraceProcess p(shared("time_s,delay_ms,lost\n0,50,0\n1,50,0\n2,,1\n3,50,0\n"), kLinear, "");
  for (int ms = 0; ms < 3000; ms += 100) EXPECT_EQ(at(p, ms).delay, milliseconds{50}) << ms;
}

TEST(MakeTraceProcess, NeedsAFile) {
  EXPECT_THROW(make_trace_process({}, "channel.uplink.trace."), UsageError);
}

}  // namespace
}  // namespace tether
