#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <tether/pose_t.hpp>
#include <vector>

#include "common/base/errors.hpp"
#include "tests/support/folder.hpp"
#include "tests/support/refusal.hpp"
#include "tools/netem/fit.hpp"

namespace tether {
namespace {

std::string big_endian(std::uint64_t value, int size) {
  std::string bytes;
  for (int i = size - 1; i >= 0; --i) bytes += static_cast<char>(value >> (8 * i));
  return bytes;
}

std::string little_endian(std::uint64_t value, int size) {
  const std::string bytes = big_endian(value, size);
  return {bytes.rbegin(), bytes.rend()};
}

template <class Function>
std::string refusal(Function function) {
  return refusal_of([&] { function(); });
}

FitInput csv(const std::string& text) {
  std::istringstream in(text);
  return read_fit_csv(in, "f.csv");
}

/// The packets' fates as a word: '.' received, 'x' lost, '|' between segments.
std::string fates(const FitInput& input) {
  std::string word;
  for (const auto& segment : input.log.segments) {
    if (!word.empty()) word += '|';
    for (const LoggedPacket& p : segment) word += p.lost ? 'x' : '.';
  }
  return word;
}

// ---------------------------------------------------------------------------- CSV

TEST(ReadFitCsv, ArrivalsByNumber) {
  const FitInput input = csv("seq,time_s,delay_ms\n7,0.0,1.5\n8,0.1,\n11,0.4,2\n10,0.41,3\n");
  EXPECT_EQ(fates(input), "..x..");
  EXPECT_DOUBLE_EQ(input.log.segments[0][0].delay_s, 0.0015);
  EXPECT_TRUE(std::isnan(input.log.segments[0][1].delay_s));
  EXPECT_EQ(input.notes, std::vector<std::string>{"1 arrived out of order"});
}

TEST(ReadFitCsv, AllPacketsWithTheirFate) {
  const FitInput input = csv("time_s,lost,delay_ms\n0,0,5\n1,1,\n2,0,6\n");
  EXPECT_EQ(fates(input), ".x.");
  EXPECT_DOUBLE_EQ(input.log.interval_s, 1.0);
  EXPECT_DOUBLE_EQ(input.log.segments[0][2].delay_s, 0.006);
}

/// 1000 arrivals at 10 Hz; `number` says which they claim to be.
std::string numbered(const std::function<int(int)>& number) {
  std::string text = "seq,time_s\n";
  for (int i = 0; i < 1000; ++i) text += fmt::format("{},{}\n", number(i), 0.1 * i);
  return text;
}

TEST(ReadFitCsv, SaysWhatIsLeftOut) {
  EXPECT_EQ(
      csv(numbered([](int i) { return i % 400; })).notes,
      std::vector<std::string>{"the sender restarted 2 times; losses in between are not known"});
  EXPECT_EQ(csv(numbered([](int i) { return i == 500 ? 50'000 : i; })).notes,
            std::vector<std::string>{"1 arrival left out: sequence number or time does not fit the "
                                     "others (damaged?)"});
}

TEST(ReadFitCsv, RefusesNumbersThatDoNotFitTheTimes) {
  const auto message = [](const std::function<int(int)>& number) -> std::string {
    try {
      csv(numbered(number));
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "accepted";
  };
  EXPECT_EQ(message([](int i) { return i % 10 == 5 ? i + 50'000 : i; }),
            "f.csv: the sequence numbers do not fit the times: 100 of 1000 arrivals belong to no "
            "run of numbers");
  EXPECT_EQ(message([](int) { return 7; }),
            "f.csv: the sequence numbers do not fit the times: 999 of 1000 arrivals have a number "
            "that had arrived");
}

TEST(ReadFitCsv, RefusesWithFileAndLine) {
  const std::vector<std::pair<std::string, std::string>> cases{
      {"seq,when\n1,2\n",
       "f.csv:1: the header must name the columns seq and time_s, or time_s and lost"},
      {"seq,time_s\n1,0\n1.5,1\n", "f.csv:3: seq = \"1.5\" must be a whole number"},
      {"seq,time_s\n1,soon\n", "f.csv:2: time_s = \"soon\" must be a finite number"},
      {"seq,time_s,delay_ms\n1,0,-2\n",
       "f.csv:2: delay_ms = \"-2\" must be empty or a number in [0, 1e12]"},
      {"seq,time_s,delay_ms\n1,0,1e308\n",
       "f.csv:2: delay_ms = \"1e308\" must be empty or a number in [0, 1e12]"},
      {"seq,time_s\n-1,0\n", "f.csv:2: seq = \"-1\" must be a whole number >= 0"},
      {"seq,time_s\n1,-1e308\n2,0\n",
       "f.csv:2: time_s = \"-1e308\" must be within 1e9 s of the first row's, and within 1e10 s of "
       "0"},
      {"time_s,lost\n0,0\n1e9,1\n1e9,0\n1.1e9,0\n",
       "f.csv:5: time_s = \"1.1e9\" must be within 1e9 s of the first row's, and within 1e10 s of "
       "0"},
      {"time_s,lost\n0,no\n", "f.csv:2: lost = \"no\" must be 0 or 1"},
      {"time_s,lost\n1,0\n0,0\n", "f.csv:3: time_s goes back from 1 to 0"}};
  for (const auto& [text, message] : cases) {
    const std::string& content = text;
    EXPECT_EQ(refusal([&] { csv(content); }), message);
  }
}

// ---------------------------------------------------------------------------- pcap

struct Udp {
  int port;
  std::string payload;
};

std::string lcm_message(std::uint32_t seq) {
  return "LC02" + big_endian(seq, 4) + std::string("AGV/POSE\0payload", 16);
}
std::string lcm_fragment(std::uint32_t seq, int number) {
  return "LC03" + big_endian(seq, 4) + big_endian(100'000, 4) + big_endian(0, 4) +
         big_endian(static_cast<std::uint64_t>(number), 2) + big_endian(2, 2) + "data";
}

std::string ip_packet(const Udp& udp, int fragment_offset = 0) {
  const std::string datagram = big_endian(static_cast<std::uint64_t>(udp.port), 2) +
                               big_endian(7667, 2) + big_endian(8 + udp.payload.size(), 2) +
                               big_endian(0, 2) + udp.payload;
  return std::string("\x45\0", 2) + big_endian(20 + datagram.size(), 2) + big_endian(0, 2) +
         big_endian(static_cast<std::uint64_t>(fragment_offset), 2) + "\x01\x11" +
         big_endian(0, 2) + "\x0a\x01\x02\x03" + "\xef\xff\x4c\x43" + datagram;
}

std::string ethernet(const std::string& ip, bool vlan = false) {
  return std::string(12, '\x02') + (vlan ? std::string("\x81\0\0\x05", 4) : "") +
         std::string("\x08\0", 2) + ip;
}

std::string pcap_header(std::uint32_t link_type) {
  return "\xd4\xc3\xb2\xa1" + little_endian(2, 2) + little_endian(4, 2) + std::string(8, '\0') +
         little_endian(262144, 4) + little_endian(link_type, 4);
}

std::string pcap_record(double time_s, const std::string& frame) {
  const auto us = static_cast<std::uint64_t>(std::llround(time_s * 1e6));
  return little_endian(us / 1'000'000, 4) + little_endian(us % 1'000'000, 4) +
         little_endian(frame.size(), 4) + little_endian(frame.size(), 4) + frame;
}

FitInput pcap(const std::string& bytes, const std::string& sender = "") {
  std::istringstream in(bytes);
  return read_fit_pcap(in, "f.pcap", sender);
}

TEST(ReadFitPcap, FollowsTheNumbersOfLcmsMessages) {
  const FitInput input =
      pcap(pcap_header(1) + pcap_record(5.0, ethernet(ip_packet({1234, lcm_message(20)}))) +
           pcap_record(5.1, ethernet(ip_packet({1234, lcm_message(21)}), true)) +
           pcap_record(5.15, ethernet(ip_packet({1234, "not LCM's, but long"}))) +
           pcap_record(5.3, ethernet(ip_packet({1234, lcm_fragment(23, 0)}))) +
           pcap_record(5.31, ethernet(ip_packet({1234, lcm_fragment(23, 1)}))) +
           pcap_record(5.32, ethernet(ip_packet({1234, lcm_message(99)}, 185))));
  EXPECT_EQ(fates(input), "..x.");
  EXPECT_NEAR(input.log.interval_s, 0.1, 1e-6);
  EXPECT_EQ(input.description, "f.pcap, LCM messages from 10.1.2.3:1234");
}

TEST(ReadFitPcap, KnowsOtherLinkTypes) {
  const std::string ip = ip_packet({1, lcm_message(3)}), next = ip_packet({1, lcm_message(5)});
  const std::vector<std::pair<std::uint32_t, std::string>> headers{
      {101, ""},
      {0, std::string(4, '\0')},
      {113, std::string(14, '\0') + std::string("\x08\0", 2)},
      {276, std::string("\x08\0", 2) + std::string(18, '\0')}};
  for (const auto& [type, header] : headers) {
    EXPECT_EQ(fates(pcap(pcap_header(type) + pcap_record(0, header + ip) +
                         pcap_record(1, header + next))),
              ".x.")
        << type;
  }
}

TEST(ReadFitPcap, ReadsTheOtherByteOrderAndNanoseconds) {
  const auto record = [](std::uint32_t ns, const std::string& frame) {
    return big_endian(9, 4) + big_endian(ns, 4) + big_endian(frame.size(), 4) +
           big_endian(frame.size(), 4) + frame;
  };
  const std::string header = "\xa1\xb2\x3c\x4d" + big_endian(2, 2) + big_endian(4, 2) +
                             std::string(8, '\0') + big_endian(65535, 4) + big_endian(101, 4);
  const FitInput input = pcap(header + record(0, ip_packet({1, lcm_message(0)})) +
                              record(500'000'000, ip_packet({1, lcm_message(1)})));
  EXPECT_DOUBLE_EQ(input.log.interval_s, 0.5);
}

TEST(ReadFitPcap, WantsASenderWhereThereAreSeveral) {
  const std::string two = pcap_header(101) + pcap_record(0, ip_packet({1, lcm_message(3)})) +
                          pcap_record(1, ip_packet({2, lcm_message(700)})) +
                          pcap_record(2, ip_packet({1, lcm_message(4)}));
  EXPECT_EQ(refusal([&] { pcap(two); }),
            "f.pcap has several senders; choose one with --sender: 10.1.2.3:1 (2 messages), "
            "10.1.2.3:2 (1 messages)");
  EXPECT_EQ(fates(pcap(two, "10.1.2.3:1")), "..");
}

TEST(ReadFitPcap, RefusesDamageAndEndsAtATruncatedRecord) {
  EXPECT_EQ(refusal([] { pcap("\xd4\xc3\xb2\xa1"); }), "f.pcap: too short for a pcap file");
  EXPECT_EQ(refusal([] { pcap(pcap_header(147)); }), "f.pcap: link type 147 is not supported");
  EXPECT_EQ(refusal([] { pcap(pcap_header(1)); }), "f.pcap: no LCM messages over UDP and IPv4");
  const std::string one = pcap_header(101) + pcap_record(0, ip_packet({1, lcm_message(3)}));
  EXPECT_EQ(fates(pcap(one + one.substr(24, 30))), ".");
  EXPECT_EQ(refusal([&] { pcap(one + std::string(16, '\x7f')); }),
            "f.pcap: the record at byte 92 claims 2139062143 bytes: damaged");
  for (std::size_t size = 0; size < one.size() - 24 - 16; ++size) {  // every shorter frame
    const std::string frame = ip_packet({1, lcm_message(3)}).substr(0, size);
    refusal([&] { pcap(pcap_header(101) + pcap_record(0, frame)); });
  }
}

// ---------------------------------------------------------------------------- event log

std::string record(std::int64_t timestamp_us, const std::string& channel, const std::string& data) {
  return big_endian(0xEDA1DA01, 4) + big_endian(0, 8) +
         big_endian(static_cast<std::uint64_t>(timestamp_us), 8) + big_endian(channel.size(), 4) +
         big_endian(data.size(), 4) + channel + data;
}

std::string pose(std::int64_t utime_us, std::int64_t seq) {
  pose_t m{};
  m.utime = utime_us;
  m.seq = seq;
  std::string bytes(static_cast<std::size_t>(m.getEncodedSize()), '\0');
  m.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

FitInput log(const std::string& bytes, const std::string& channel = "") {
  std::istringstream in(bytes);
  return read_fit_log(in, "run.lcmlog", channel);
}

TEST(ReadFitLog, FollowsTheNumbersOfOneChannelAndItsDelays) {
  const std::string bytes =
      record(60'000, "CTRL/POSE", pose(0, 0)) + record(110'000, "CTRL/POSE", pose(50'000, 1)) +
      record(110'000, "OTHER", "what is this") + record(130'000, "CTRL/POSE", "cannot be decoded") +
      record(260'000, "CTRL/POSE", pose(200'000, 4));
  const FitInput input = log(bytes);
  EXPECT_EQ(fates(input), "..xx.");
  EXPECT_DOUBLE_EQ(input.log.segments[0][0].delay_s, 0.06);
  EXPECT_EQ(input.description, "run.lcmlog, channel CTRL/POSE");
  EXPECT_EQ(input.notes, std::vector<std::string>{"1 messages without a sequence number left out"});
}

TEST(ReadFitLog, KnowsNoDelaysWhereTheTimeStampsAreOfAnotherClock) {
  const std::int64_t today_us = 1'800'000'000'000'000;
  const FitInput input = log(record(today_us, "CTRL/POSE", pose(0, 0)) +
                             record(today_us + 50'000, "CTRL/POSE", pose(50'000, 1)));
  EXPECT_TRUE(std::isnan(input.log.segments[0][0].delay_s));
}

TEST(ReadFitLog, WantsAChannelWhereThereAreSeveral) {
  const std::string bytes =
      record(0, "B", pose(0, 0)) + record(1, "A", pose(0, 5)) + record(2, "A", pose(0, 7));
  EXPECT_EQ(refusal([&] { log(bytes); }),
            "run.lcmlog has several channels; choose one with --channel: A, B");
  EXPECT_EQ(fates(log(bytes, "A")), ".x.");
  EXPECT_EQ(refusal([&] { log(bytes, "C"); }),
            "run.lcmlog: no messages with a sequence number on channel \"C\"");
}

// ---------------------------------------------------------------------------- any file

TEST(ReadFitInput, TellsTheFormatsApart) {
  const test::Folder folder;
  const auto read = [&](const std::string& bytes) {
    const auto path = folder.file("some file", bytes);
    return read_fit_input(path.string(), {}).description.substr(path.string().size());
  };
  EXPECT_EQ(read("seq,time_s\n1,0\n"), "");
  EXPECT_EQ(read(pcap_header(101) + pcap_record(0, ip_packet({1, lcm_message(3)}))),
            ", LCM messages from 10.1.2.3:1");
  EXPECT_EQ(read(record(0, "A", pose(0, 0))), ", channel A");
  EXPECT_NE(refusal([&] { read("\x0a\x0d\x0d\x0a and so on"); }).find("editcap -F pcap"),
            std::string::npos);
  EXPECT_THAT(refusal([&] { read_fit_input("/nowhere", {}); }),
              ::testing::HasSubstr("cannot read the recording \"/nowhere\""));
  EXPECT_THAT(refusal([&] { read_fit_input("/tmp", {}); }), ::testing::HasSubstr("is a directory"));
  EXPECT_THAT(refusal([&] { read_fit_input("/dev/zero", {}); }),
              ::testing::HasSubstr("regular file"));
}

}  // namespace
}  // namespace tether
