// Measurements of other tools become a trace that the channel takes, or are refused with their
// line.
#include "tools/netem/import.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>

#include "tests/tools/netem/import_test.hpp"

namespace tether {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

Imported csv(const std::string& text, const ImportColumns& columns = {}) {
  std::istringstream in(text);
  return import_csv(in, "m.csv", columns);
}

Imported ping(const std::string& text, double interval_s = 1.0) {
  std::istringstream in(text);
  return import_ping(in, "p.txt", interval_s);
}

TEST(ImportCsv, TakesUnitsFromNamesAndEpochsToTheNanosecond) {
  const auto trace =
      trace_of(csv("Timestamp (ns),Latency [us],loss_percent\n"
                   "1700000000000000001,2500,0\n1700000000000000002,1e3,25\n"
                   "1700000001000000001,0,100\n"));
  EXPECT_EQ(trace.rows[1].since_first, std::chrono::nanoseconds{1});
  EXPECT_EQ(trace.rows[2].since_first, std::chrono::seconds{1});
  EXPECT_THAT(delays(trace), ElementsAre(2.5, 1.0, 0.0));
  EXPECT_THAT(prrs(trace), ElementsAre(1.0, 0.75, 0.0));
}

TEST(ImportCsv, TakesColumnsThatAreNamed) {
  const ImportColumns columns{.time = "when:ms", .delay = "d:s", .loss = "p:prr_percent"};
  const auto trace = trace_of(csv("p,d,when,lost\n100,0.02,500,x\n40,0.03,1500,y\n", columns));
  EXPECT_EQ(trace.rows[1].since_first, std::chrono::seconds{1});
  EXPECT_THAT(delays(trace), ElementsAre(20.0, 30.0));
  EXPECT_THAT(prrs(trace), ElementsAre(1.0, 0.4));
}

TEST(ImportCsv, HalvesRoundTripsAndTakesMissingOnesForLosses) {
  const Imported imported = csv("time_s,rtt_ms\n10,8\n11,\n12,nan\n13,4\n");
  EXPECT_THAT(imported.notes, ElementsAre("delays are half the round trips"));
  const auto trace = trace_of(imported);
  EXPECT_TRUE(trace.of_fates);
  EXPECT_THAT(prrs(trace), ElementsAre(1.0, 0.0, 0.0, 1.0));
  EXPECT_DOUBLE_EQ(delays(trace).front(), 4.0);
  EXPECT_DOUBLE_EQ(delays(trace).back(), 2.0);
}

TEST(ImportCsv, KeepsTheLastRowOfAnInstantAndSaysSo) {
  const Imported imported = csv("t_s,prr\n0,0.1\n1,0.2\n1,0.3\n2,0.4\n");
  EXPECT_THAT(prrs(trace_of(imported)), ElementsAre(0.1, 0.3, 0.4));
  EXPECT_THAT(imported.notes, ElementsAre(HasSubstr("1 left out")));
}

TEST(ImportCsv, RefusesWhatIsNotClear) {
  const auto says = [](const std::string& text, const ImportColumns& columns = {}) {
    return refusal([&] { csv(text, columns); });
  };
  EXPECT_EQ(
      says("time_s,rtt\n0,1\n"),
      "m.csv:1: column \"rtt\" needs its unit: --delay \"rtt:UNIT\", one of ns, us, µs, ms, s");
  EXPECT_THAT(says("time,prr\n0,1\n"),
              HasSubstr("m.csv:2: time = \"0\" must be like 2026-11-26T15:04:05.123Z"));
  EXPECT_THAT(says("time,prr\n0,1\n"),
              HasSubstr("needs its unit: --time \"time:UNIT\", one of ns, us, µs, ms, s"));
  EXPECT_EQ(says("t,prr\n0,1\n", {.time = "t:min"}),
            "m.csv:1: --time \"t:min\": the unit must be one of ns, us, µs, ms, s, iso");
  EXPECT_THAT(says("time_s,prr\n2026-11-26T15:04:05Z,1\n"), HasSubstr("must be a number of s, or"));
  for (const char* losses : {"lost", "loss_percent"}) {
    EXPECT_EQ(says(fmt::format("time_s,{}\n0,0\n1,\n", losses)),
              fmt::format("m.csv:3: {} = \"\" must be a value: leave out rows whose losses are not "
                          "known",
                          losses));
  }
  EXPECT_THAT(says("time_s,loss\n0,1\n"),
              HasSubstr("one of lost, share, percent, prr, prr_percent"));
  EXPECT_THAT(says("time_s,rtt_ms,delay_ms\n0,1,1\n"), HasSubstr("Say which with --delay"));
  EXPECT_THAT(says("time_s,x\n0,1\n"), HasSubstr("neither delays nor losses"));
  EXPECT_THAT(says("x,prr\n0,1\n"), HasSubstr("no column is a time"));
  EXPECT_THAT(says("time_s,prr\n0,1\n", {.loss = "y:prr"}), HasSubstr("has no column \"y\""));
  EXPECT_THAT(says("time_s,prr\n1,1\n0,1\n"), HasSubstr("m.csv:3: time_s"));
  EXPECT_THAT(says("time_s,prr\n1,1.2\n"), HasSubstr("m.csv:2: prr"));
  EXPECT_THAT(says("time_s,delay_ms\n1,-1\n"), HasSubstr("m.csv:2: delay_ms"));
  EXPECT_THAT(says("time_s,delay_ms,lost\n1,,0\n"), HasSubstr("where not all is lost"));
  EXPECT_THAT(says("time_s,prr\n"), HasSubstr("no rows"));
}

TEST(ImportCsv, TakesSemicolonsAndTabsWhereTheHeaderHasNoComma) {
  for (const std::string text : {"time_s;rtt_ms;lost\n0;20;0\n1;;1\n2;30;0\n",
                                 "time_s\trtt_ms\tlost\n0\t20\t0\n1\t\t1\n2\t30\t0\n"}) {
    const auto trace = trace_of(csv(text));
    EXPECT_THAT(prrs(trace), ElementsAre(1.0, 0.0, 1.0));
    EXPECT_THAT(delays(trace), ElementsAre(10.0, 12.5, 15.0));
  }
  EXPECT_THAT(refusal([] { csv("time_s;prr\n0;0,5\n"); }), HasSubstr("prr = \"0,5\" must be"));
}

TEST(ImportCsv, TakesNamesWithCommasBetweenQuotes) {
  const std::string header = R"-("time, local (s)","delay, one way (ms)")-";
  for (const char* delay : {"", "delay, one way (ms):ms", "delay, one way (ms)"}) {
    const Imported imported =
        csv(header + "\n0,20\n1,\"30\"\n", {.time = "time, local (s)", .delay = delay});
    EXPECT_THAT(delays(trace_of(imported)), ElementsAre(20.0, 30.0));
    EXPECT_TRUE(imported.notes.empty());  // not halved
  }
  EXPECT_THAT(delays(trace_of(csv("\"delay, one way (ms)\";t_s\n5;0\n6;1\n"))),
              ElementsAre(5.0, 6.0));
}

TEST(ImportCsv, TakesTimesInIso8601) {
  const auto seconds = [](const std::string& rows, const ImportColumns& columns = {}) {
    return times(csv("time,prr\n" + rows, columns));
  };
  EXPECT_THAT(seconds("2026-11-26T15:04:05.123Z,1\n2026-11-26T15:04:06.123000001Z,1\n"),
              ElementsAre(0.0, 1.000000001));
  EXPECT_THAT(seconds("2024-02-28 23:59:59,1\n2024-03-01 00:00:00.5,1\n", {.time = "time:iso"}),
              ElementsAre(0.0, 86401.5));
  EXPECT_THAT(seconds("2026-11-26T15:00:00+01:00,1\n2026-11-26T09:30:01-0500,1\n"
                      "2026-11-26T14:30:02Z,1\n",
                      {.time = "time"}),
              ElementsAre(0.0, 1801.0, 1802.0));
  for (const char* wrong :
       {"2026-11-26", "2026-13-26T15:04:05Z", "2026-02-30T15:04:05Z", "2026-11-26T24:04:05Z",
        "2026-11-26T15:04:05.Z", "2026-11-26T15:04:05 CET", "2026-11-26T15:04:05+1",
        "26.11.2026 15:04:05", "2026-11-26X15:04:05Z", ""}) {
    EXPECT_THAT(refusal([&] { seconds(std::string(wrong) + ",1\n"); }),
                HasSubstr(fmt::format("time = \"{}\" must be like", wrong)));
  }
}

TEST(ImportCsv, SaysWhatASingleRowMeans) {
  Imported imported = csv("time_s,prr\n7,0.5\n");
  apply({}, imported, "m.csv");
  EXPECT_THAT(imported.notes, ElementsAre(HasSubstr("a single row: it holds")));
  EXPECT_THAT(prrs(trace_of(imported)), ElementsAre(0.5));
}

constexpr char kPing[] =
    "PING 10.0.0.2 (10.0.0.2) 56(84) bytes of data.\n"
    "[1700000000.010000] 64 bytes from 10.0.0.2: icmp_seq=1 ttl=64 time=10.0 ms\n"
    "[1700000001.000000] no answer yet for icmp_seq=2\n"
    "[1700000002.030000] 64 bytes from 10.0.0.2: icmp_seq=3 ttl=64 time=30.0 ms\n"
    "[1700000002.031000] 64 bytes from 10.0.0.2: icmp_seq=3 ttl=64 time=31.0 ms (DUP!)\n"
    "\n--- 10.0.0.2 ping statistics ---\n"
    "5 packets transmitted, 2 received, 60% packet loss, time 4000ms\n";

TEST(ImportPing, TellsWhenWhatWasSentAndWhatBecameOfIt) {
  const Imported imported = ping(kPing);
  ASSERT_EQ(imported.rows.size(), 5U);  // two at the end, of which nothing was heard
  for (std::size_t i = 0; i < 5; ++i) EXPECT_NEAR(times(imported)[i], static_cast<double>(i), 1e-6);
  const auto trace = trace_of(imported);
  EXPECT_THAT(prrs(trace), ElementsAre(1.0, 0.0, 1.0, 0.0, 0.0));
  EXPECT_DOUBLE_EQ(delays(trace)[0], 5.0);
  EXPECT_DOUBLE_EQ(delays(trace)[2], 15.0);
}

TEST(ImportPing, GoesOnWhereNumbersBeginAgainAndWithoutTimes) {
  const Imported imported = ping(
      "64 bytes from h: icmp_seq=65534 ttl=64 time=1 ms\n64 bytes from h: icmp_seq=0 ttl=64 time=1 "
      "ms\n"
      "64 bytes from h: icmp_seq=65535 ttl=64 time=1 ms\n64 bytes from h: icmp_seq=2 ttl=64 time=1 "
      "ms\n",
      0.2);
  EXPECT_THAT(prrs(trace_of(imported)), ElementsAre(1.0, 1.0, 1.0, 0.0, 1.0));
  EXPECT_NEAR(times(imported).back(), 0.8, 1e-9);
  EXPECT_THAT(imported.notes.back(), HasSubstr("one every 0.2 s is assumed"));
}

TEST(ImportPing, KnowsBusyboxAndRefusesWhatIsNoPing) {
  EXPECT_EQ(ping("64 bytes from 1.1.1.1: seq=0 ttl=57 time=12.0 ms\n"
                 "64 bytes from 1.1.1.1: seq=2 ttl=57 time=12.0 ms\n\n3 packets transmitted\n")
                .rows.size(),
            3U);
  EXPECT_THAT(refusal([] { ping("hello\n"); }), HasSubstr("no line has icmp_seq="));
  EXPECT_THAT(refusal([] { ping("Antwort von 192.0.2.7: Bytes=32 Zeit=12ms TTL=57\n"); }),
              HasSubstr("on Linux, macOS and busybox, nor begins with \"Reply from\""));
}

TEST(ImportPing, KnowsMacOs) {
  const auto trace =
      trace_of(ping("PING 192.0.2.7 (192.0.2.7): 56 data bytes\n"
                    "64 bytes from 192.0.2.7: icmp_seq=0 ttl=57 time=12.100 ms\n"
                    "Request timeout for icmp_seq 1\n"
                    "64 bytes from 192.0.2.7: icmp_seq=2 ttl=57 time=14.100 ms\n"));
  EXPECT_THAT(prrs(trace), ElementsAre(1.0, 0.0, 1.0));
}

TEST(ImportPing, KnowsWindows) {
  const std::string text =
      "\r\nPinging 192.0.2.7 with 32 bytes of data:\r\n"
      "Reply from 192.0.2.7: bytes=32 time=12ms TTL=57\r\nRequest timed out.\r\n"
      "Reply from 192.0.2.1: Destination host unreachable.\r\nGeneral failure.\r\n"
      "Reply from 2001:db8::7: time<1ms\r\n\r\nPing statistics for 192.0.2.7:\r\n"
      "    Packets: Sent = 5, Received = 2, Lost = 3 (60% loss),\r\n";
  EXPECT_EQ(format_of_measurement(text), "ping");
  const Imported imported = ping(text);
  EXPECT_THAT(times(imported), ElementsAre(0, 1, 2, 3, 4));
  EXPECT_THAT(imported.notes.back(), HasSubstr("Windows waits 4 s for what is lost"));
  const auto trace = trace_of(imported);
  EXPECT_THAT(prrs(trace), ElementsAre(1.0, 0.0, 0.0, 0.0, 1.0));
  EXPECT_DOUBLE_EQ(delays(trace).front(), 6.0);
  EXPECT_DOUBLE_EQ(delays(trace).back(), 0.25);
}

TEST(ImportPing, RefusesANumberThatIsFarBeyondWhatWasSent) {
  std::istringstream in("64 bytes: icmp_seq=700000000500000000 time=1 ms\n5 packets transmitted\n");
  EXPECT_THAT(refusal([&] { import_ping(in, "p.txt", 1.0); }),
              HasSubstr("p.txt:1: the number is 7e+17, which must be in [0, 2e+07]"));
  EXPECT_THAT(refusal([] {
                ping("64 bytes: icmp_seq=1 time=1 ms\n64 bytes: icmp_seq=9000000 time=1 ms\n");
              }),
              HasSubstr("p.txt: numbers from 1 to 9000000, of which the file has 2; at most"));
}

TEST(ImportPing, RefusesNumbersAndTimesThatNoPingHas) {
  for (const char* number : {"9223372036854775807", "9223372036854770000", "20000001"}) {
    const std::string line = std::string(" seq=") + number + " time=1 ms\n";
    EXPECT_THAT(refusal([&] { ping("64 bytes: seq=65535 time=1 ms\n64 bytes:" + line); }),
                HasSubstr("p.txt:2: the number is "));
  }
  EXPECT_THAT(refusal([] { ping("64 bytes: seq=1 time=10000000000 ms\n"); }),
              HasSubstr("p.txt:1: the round trip in ms is 1e+10"));
  EXPECT_THAT(refusal([] { ping("[1" + std::string(300, '0') + "] 64 bytes: seq=1 time=1 ms\n"); }),
              HasSubstr("p.txt:1: the time in s is 1e+300"));
}

TEST(ImportPing, RefusesNumbersThatGoOnInAWayThatIsNotRead) {
  const std::pair<const char*, const char*> lines[] = {
      {"64 bytes: icmp_seq=1 time=10,5 ms\n", R"(p.txt:1: "10,5" behind "time=" must be digits)"},
      {"64 bytes: icmp_seq=1 time=1e3 ms\n", R"(p.txt:1: "1e3" behind "time=")"},
      {"64 bytes: icmp_seq=1e2 time=1 ms\n", R"(p.txt:1: "1e2" behind "icmp_seq=")"},
      {"[1e300] 64 bytes: icmp_seq=1 time=1 ms\n", R"(p.txt:1: "1e300" behind "[")"},
  };
  for (const auto& [line, error] : lines) {
    EXPECT_THAT(refusal([&text = line] { ping(text); }), HasSubstr(error)) << line;
  }
}

TEST(ImportPing, RefusesTimesThatDoNotGoOn) {
  for (const char* second : {"100.0", "99.0"}) {
    const std::string text = "[100.0] 64 bytes: icmp_seq=1 time=1 ms\n[" + std::string(second) +
                             "] 64 bytes: icmp_seq=60000 time=1 ms\n";
    EXPECT_THAT(refusal([&] { ping(text); }), HasSubstr("p.txt: the times in brackets are"))
        << second;
  }
}

TEST(ImportGaps, HoldLoseOrEndIt) {
  const std::string text = "time_s,prr\n0,1\n1,1\n2,0.5\n100,1\n101,1\n102,1\n";
  Imported held = csv(text);
  apply({}, held, "m.csv");
  EXPECT_EQ(held.rows.size(), 6U);
  EXPECT_THAT(held.notes,
              ElementsAre(HasSubstr("1 gap longer than 10 s, the longest of 98 s at 2 s")));
  Imported lost = csv(text);
  apply({.meaning = GapRule::Meaning::lost, .longer_than_s = 50.0}, lost, "m.csv");
  EXPECT_THAT(times(lost), ElementsAre(0, 1, 2, 3, 100, 101, 102));
  EXPECT_EQ(lost.rows[3].prr, 0.0);
  Imported refused = csv(text);
  EXPECT_THAT(refusal([&] {
                apply({.meaning = GapRule::Meaning::refuse, .longer_than_s = 0.0}, refused,
                      "m.csv");
              }),
              HasSubstr("m.csv: 1 gap"));
  Imported none = csv(text);
  apply({.meaning = GapRule::Meaning::refuse, .longer_than_s = 99.0}, none, "m.csv");
  EXPECT_TRUE(none.notes.empty());
}

TEST(ImportFormat, IsKnownByHowAFileBegins) {
  EXPECT_EQ(format_of_measurement(kPing), "ping");
  EXPECT_EQ(format_of_measurement("\n{\"start\":{}}"), "iperf3");
  EXPECT_EQ(format_of_measurement("Connecting to host 10.0.0.2, port 5201\n"), "iperf3");
  EXPECT_EQ(format_of_measurement("[ ID] Interval           Transfer     Bitrate\n"), "iperf3");
  EXPECT_EQ(format_of_measurement("Antwort von 192.0.2.7: Bytes=32 Zeit=12ms TTL=57\n"), "ping");
  EXPECT_EQ(format_of_measurement("Request timed out.\n"), "ping");
  EXPECT_EQ(format_of_measurement("time_s,prr\n"), "csv");
}

TEST(ImportGaps, WhatIsBeyondATracesBoundsIsRefused) {
  const auto told = [](const std::string& rows) {
    Imported imported = csv("time_s,delay_ms\n" + rows);
    return refusal([&] { apply({}, imported, "m.csv"); });
  };
  EXPECT_EQ(told("0,1\n1e9,1e9\n"), "accepted");
  EXPECT_THAT(told("0,1\n1.1e9,1\n"), HasSubstr("1.1e+09 s apart"));
  EXPECT_THAT(told("0,1\n1,1.1e9\n"), HasSubstr("a delay is 1.1e+09 ms"));
  EXPECT_THAT(told("0,1.1e9\n"), HasSubstr("a delay is"));
}

}  // namespace
}  // namespace tether
