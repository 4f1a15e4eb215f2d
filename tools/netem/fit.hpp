#pragma once

#include <istream>
#include <string>
#include <vector>

#include "netem/fit/data.hpp"

namespace tether {

/// Which of a file's streams to read.
struct FitSelection {
  std::string channel;  ///< LCM event log: the channel; "" if only one has sequence numbers
  std::string sender;   ///< pcap: "IP:PORT" of the sender; "" if there is only one
};

/// A stream of packets as a file has it.
struct FitInput {
  FateLog log;
  std::string description;         ///< "my.pcap, LCM messages from 10.0.0.2:41234"
  std::vector<std::string> notes;  ///< further notes for the reader, one line each
};

/// Reads the sequence numbers and times of the packets that arrived, and so which were lost, from:
///
/// - an LCM event log: the field `seq` of the messages of one channel, of any of Tether's types. In
///   logs of simulated runs, whose time stamps are the run's, time stamp − `utime` is the delay.
/// - a capture in classic pcap format (Ethernet, Linux "any", raw IP or loopback; IPv4): the
///   numbers in the headers of LCM's UDP messages. LCM counts all messages of a sender, whatever
///   their channel, so the capture must have all of them. Of messages in several fragments the
///   first fragment counts. (pcapng: `editcap -F pcap` converts.)
/// - CSV with a header line: columns seq and time_s, in the order of arrival, of packets that
///   arrived; or time_s and lost (0 or 1), in the order of sending, of all packets. A column
///   delay_ms may follow (empty if unknown), others are ignored; so are empty lines and lines
///   beginning with '#'.
///
/// Throws UsageError, with file and line or byte, for what cannot be read, and std::runtime_error
/// for a log whose sequence numbers do not fit its times: more than kMostImplausible of them, or
/// more than kMostCopies of the arrivals with a number that had arrived.
FitInput read_fit_input(const std::string& path, const FitSelection& selection);

inline constexpr double kMostImplausible = 0.05, kMostCopies = 0.67;

/// The parts of read_fit_input(); `name` stands for the file in messages.
/// `findings` become notes, or part of the refusal.
FitInput fit_input_from(const std::vector<Reception>& receptions, const std::string& description,
                        const std::vector<std::string>& findings = {});
FitInput read_fit_csv(std::istream& in, const std::string& name);
FitInput read_fit_pcap(std::istream& in, const std::string& name, const std::string& sender);
FitInput read_fit_log(std::istream& in, const std::string& name, const std::string& channel);

}  // namespace tether
