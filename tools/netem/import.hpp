#pragma once

#include <istream>
#include <optional>
#include <string>
#include <vector>

namespace tether {

/// Measurements of an external tool, on their way to a trace (netem/models/trace.hpp).
struct Imported {
  struct Row {
    double time_s = 0.0;               ///< since the first row, strictly increasing
    std::optional<double> delay_ms{};  ///< one way
    double prr = 1.0;
  };
  std::vector<Row> rows;  ///< one or more
  bool of_fates = false;  ///< each row is a packet: prr is 0 or 1
  bool has_delays = false;
  std::vector<std::string> notes;  ///< notes on the conversion, one line each
};

/// Which columns of a CSV file mean what: "NAME:UNIT", or "NAME" if its end says the unit, as
/// delay_ms and "rtt (us)" do. Empty: the only one whose name is of the kind.
///
/// - time: ns, us, ms, s; since any instant; iso (from_iso_time()), if nothing says the unit. time,
///   timestamp, ts, t, epoch
/// - delay: ns, us, ms, s. delay, latency, owd, delay_one_way, one_way_delay; rtt and ping are
///   halved
/// - loss: lost (0 or 1), share (of packets lost), percent (of them lost), prr (share that
///   arrived), prr_percent. lost, loss, prr
struct ImportColumns {
  std::string time{}, delay{}, loss{};
  bool round_trip = false;  ///< delays are halved, whatever their name
};

/// A row without a delay where there is no column of losses is a lost packet. Of rows of one
/// instant the last counts. Throws UsageError with file, line and column.
Imported import_csv(std::istream& in, const std::string& name, const ImportColumns& columns);

/// Imports the output of ping of iputils, macOS or busybox writes, best with -D (times) and -O
/// (none needed): a number that is missing was lost. Windows' (in English) has a line for each
/// packet. Delays are half the round trips. Without times, packets are `interval_s` apart.
Imported import_ping(std::istream& in, const std::string& name, double interval_s);

/// Imports the output of iperf3: of UDP the receiver's report, in text or JSON (-J; of the client
/// with
/// --get-server-output): a row for each interval, with its share of packets that arrived, of all
/// streams together; of TCP the sender's in JSON: half the round trip times. The summary and what
/// is omitted (-O) do not count. Throws UsageError for a file without such a report, or with two.
Imported import_iperf3(const std::string& text, const std::string& name);

/// Rule for times without rows.
struct GapRule {
  enum class Meaning { hold, lost, refuse };
  Meaning meaning = Meaning::hold;  ///< hold: the row before them holds
  double longer_than_s = 0.0;       ///< 0: ten times the median from row to row
};

/// lost: adds a row that loses everything after each row that a gap follows, as long after it as is
/// usual. Says in a note how many there are and how long the longest is.
void apply(const GapRule& rule, Imported& imported, const std::string& name);

/// The trace's file.
std::string to_trace_csv(const Imported& imported, const std::string& source);

/// "csv", "ping" or "iperf3", by what a file begins with.
std::string format_of_measurement(const std::string& text);

}  // namespace tether
