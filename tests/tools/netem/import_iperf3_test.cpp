// The receiver's intervals of iperf3 become the trace, from either side's report.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/tools/netem/import_test.hpp"

namespace tether {
namespace {

using ::testing::DoubleNear;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(ImportIperf3, ReadsTheReceiversLossesInTextAndJson) {
  const std::string text =
      "Accepted connection from 10.0.0.1, port 55000\n"
      "[ ID] Interval           Transfer     Bitrate         Jitter    Lost/Total Datagrams\n"
      "[  5]   0.00-1.00   sec   128 KBytes  1.05 Mbits/sec  0.012 ms  3/90 (3.3%)\n"
      "[  5]   1.00-2.00   sec   128 KBytes  1.05 Mbits/sec  0.012 ms  0/100 (0%)\n"
      "- - - - - - - - - - - - - - - - - - - - - - - - -\n"
      "[  5]   0.00-2.00   sec   256 KBytes  1.05 Mbits/sec  0.012 ms  3/190 (1.6%)  receiver\n";
  const std::string json =
      R"({"start":{},"intervals":[
        {"streams":[],"sum":{"start":0,"end":1,"packets":90,"lost_packets":3,"sender":false}},
        {"streams":[],"sum":{"start":1,"end":2,"packets":100,"lost_packets":0,"sender":false}}],"end":{}})";
  for (const std::string& report : {text, json, R"({"server_output_json":)" + json + "}"}) {
    const auto trace = trace_of(import_iperf3(report, "i"));
    ASSERT_EQ(trace.rows.size(), 2U);
    EXPECT_NEAR(trace.rows[0].prr, 1.0 - 3.0 / 90.0, 1e-8);
    EXPECT_EQ(trace.rows[1].prr, 1.0);
  }
}

/// Output of `iperf3 -c … -u` itself: nothing of what arrived, but in its summary.
constexpr char kClient[] =
    "Connecting to host 127.0.0.1, port 6201\n"
    "[  5] local 127.0.0.1 port 45159 connected to 127.0.0.1 port 6201\n"
    "[ ID] Interval           Transfer     Bitrate         Total Datagrams\n"
    "[  5]   0.00-1.00   sec   128 KBytes  1.05 Mbits/sec  91  \n"
    "[  5]   1.00-2.00   sec   128 KBytes  1.05 Mbits/sec  90  \n"
    "- - - - - - - - - - - - - - - - - - - - - - - - -\n"
    "[ ID] Interval           Transfer     Bitrate         Jitter    Lost/Total Datagrams\n"
    "[  5]   0.00-2.00   sec   256 KBytes  1.05 Mbits/sec  0.000 ms  0/181 (0%)  sender\n"
    "[  5]   0.00-2.04   sec   160 KBytes   642 Kbits/sec  0.011 ms  54/181 (30%)  receiver\n\n";
constexpr char kServer[] =
    "Accepted connection from 127.0.0.1, port 34342\n"
    "[  5] local 127.0.0.1 port 6202 connected to 127.0.0.1 port 51606\n"
    "[ ID] Interval           Transfer     Bitrate         Jitter    Lost/Total Datagrams\n"
    "[  5]   0.00-1.00   sec  96.0 KBytes   786 Kbits/sec  0.019 ms  80/91 (88%)  (omitted)\n"
    "[  5]   0.00-1.00   sec  64.0 KBytes   524 Kbits/sec  0.005 ms  45/91 (49%)  \n"
    "[  5]   1.00-2.00   sec  96.0 KBytes   786 Kbits/sec  0.011 ms  9/90 (10%)  \n"
    "[  5]   2.00-2.04   sec  0.00 Bytes  0.00 bits/sec  0.011 ms  0/0 (0%)  \n"
    "- - - - - - - - - - - - - - - - - - - - - - - - -\n"
    "[ ID] Interval           Transfer     Bitrate         Jitter    Lost/Total Datagrams\n"
    "[  5]   0.00-2.04   sec   160 KBytes   642 Kbits/sec  0.011 ms  54/181 (30%)  receiver\n\n";

TEST(ImportIperf3, TakesTheServersIntervalsFromAClientsReport) {
  const std::string text = std::string(kClient) + "Server output:\n" + kServer + "\niperf Done.\n";
  // With --json at the client alone, the server's report is text.
  const nlohmann::json json{{"intervals",
                             {{{"streams", nlohmann::json::array()},
                               {"sum", {{"start", 0}, {"packets", 91}, {"sender", true}}}}}},
                            {"server_output_text", kServer}};
  for (const std::string& report : {text, json.dump(), std::string(kServer)}) {
    const Imported imported = import_iperf3(report, "i");
    EXPECT_THAT(times(imported), ElementsAre(0.0, 1.0));
    EXPECT_THAT(prrs(trace_of(imported)),
                ElementsAre(DoubleNear(46.0 / 91.0, 1e-8), DoubleNear(0.9, 1e-8)));
  }
}

TEST(ImportIperf3, RefusesAReportOfAClientAlone) {
  const auto says = [](const std::string& text) {
    return refusal([&] { import_iperf3(text, "i"); });
  };
  EXPECT_THAT(says(kClient), HasSubstr("i:4: an interval without losses; losses by interval"));
  EXPECT_THAT(says(kClient), HasSubstr("--get-server-output, or what iperf3 -s writes"));
  const std::string old =  // output of iperf 3.1, which does not say whose the summary is
      "[  4]   0.00-1.00   sec   128 KBytes  1.05 Mbits/sec  16  \n- - - -\n"
      "[  4]   0.00-1.00   sec   128 KBytes  1.05 Mbits/sec  0.015 ms  0/16 (0%)  \n";
  EXPECT_THAT(says(old), HasSubstr("i:1: an interval without losses"));
  const std::string summary =
      "[  5]   0.00-2.00   sec   256 KBytes  1.05 Mbits/sec  0.000 ms  0/181 (0%)  sender\n";
  EXPECT_THAT(says(summary), HasSubstr("i: losses by interval are wanted"));
}

TEST(ImportIperf3, AddsParallelStreamsUp) {
  const auto trace = trace_of(import_iperf3(
      "[  5]   0.00-1.00   sec   128 KBytes  1.05 Mbits/sec  0.012 ms  0/91 (0%)  \n"
      "[  6]   0.00-1.00   sec   128 KBytes  1.05 Mbits/sec  0.012 ms  45/91 (49%)  \n"
      "[SUM]   0.00-1.00   sec   256 KBytes  2.10 Mbits/sec  0.012 ms  45/182 (25%)  \n"
      "- - - - - - - - - - - - - - - - - - - - - - - - -\n"
      "[  5]   1.00-2.00   sec   128 KBytes  1.05 Mbits/sec  0.012 ms  0/90 (0%)  \n"
      "[  6]   1.00-2.00   sec   128 KBytes  1.05 Mbits/sec  0.012 ms  90/90 (100%)  \n"
      "[SUM]   1.00-2.00   sec   256 KBytes  2.10 Mbits/sec  0.012 ms  90/180 (50%)  \n"
      "- - - - - - - - - - - - - - - - - - - - - - - - -\n"
      "[SUM]   0.00-2.04   sec   256 KBytes  2.10 Mbits/sec  0.012 ms  135/362 (37%)  receiver\n",
      "i"));
  EXPECT_THAT(prrs(trace), ElementsAre(DoubleNear(137.0 / 182.0, 1e-8), 0.5));
}

TEST(ImportIperf3, RefusesALogOfTwoTests) {
  EXPECT_EQ(refusal([] { import_iperf3(std::string(kServer) + kServer, "i"); }),
            "i:12: a second report with losses begins: a trace is of one");
}

TEST(ImportIperf3, ReadsRoundTripsOfTcpAndRefusesTheRest) {
  const std::string tcp =
      R"({"intervals":[{"streams":[{"rtt":30000}],"sum":{"start":0.5,"sender":true}},
                       {"streams":[{"rtt":50000}],"sum":{"start":1.5,"sender":true}}]})";
  EXPECT_THAT(delays(trace_of(import_iperf3(tcp, "i"))), ElementsAre(15.0, 25.0));
  const auto says = [](const std::string& text) {
    return refusal([&] { import_iperf3(text, "i"); });
  };
  EXPECT_THAT(says(R"({"error":"unable to connect"})"),
              HasSubstr("iperf3 says: unable to connect"));
  EXPECT_THAT(says(R"({"intervals":[{"streams":[],"sum":{"start":0,"packets":90}}]})"),
              HasSubstr("losses by interval are wanted"));
  EXPECT_THAT(says("{"), HasSubstr("no report of iperf3"));
  EXPECT_THAT(says(R"({"intervals":[{"sum":3}]})"), HasSubstr("no report of iperf3"));
  EXPECT_THAT(says("[  5]   0.00-1.00   sec   1 KBytes  1 Mbits/sec  0.01 ms  91/90 (101%)"),
              HasSubstr("more packets are lost than were sent"));
  EXPECT_THAT(says("[  5]   nan-1.00   sec   1 KBytes  1 Mbits/sec  0.01 ms  3/90 (3%)"),
              HasSubstr("its time is no number"));
}

TEST(ImportIperf3, TakesLossesThatAreTakenBackForNone) {
  const auto trace = trace_of(import_iperf3(
      "[  5]   0.00-1.00   sec   1 KBytes  1 Mbits/sec  0.01 ms  -2/90 (-2.2%)", "i"));
  ASSERT_EQ(trace.rows.size(), 1U);
  EXPECT_EQ(trace.rows[0].prr, 1.0);
}

}  // namespace
}  // namespace tether
