#pragma once

#include <iterator>
#include <string>
#include <vector>

namespace tether {

/// Who sends what a link impairs.
struct TcSender {
  std::string interface;    ///< interface of the sender's computer, towards the network
  std::string channel;      ///< LCM channel, whose name is in every packet
  double interval_s = 1.0;  ///< between packets
};

/// A link as tc-netem(8) of iproute2 6.1 and net/sched/sch_netem.c of Linux 6.18 do it.
struct TcExport {
  std::string command;  ///< `tc qdisc add dev … root netem …`, with all that has an equivalent
  /// Missing or different parts of the command, with the reason; one line each.
  std::vector<std::string> notes;
};

enum class TcPart { delay, rate, order, reorder, limit, loss, duplicate, corrupt, slot, schedule };

/// The parts of an export, in the order in which they are written. What has no equivalent comes
/// last.
inline constexpr TcPart kTcParts[] = {
    TcPart::delay, TcPart::rate,      TcPart::order,   TcPart::reorder, TcPart::limit,
    TcPart::loss,  TcPart::duplicate, TcPart::corrupt, TcPart::slot,    TcPart::schedule};
static_assert(std::size(kTcParts) == static_cast<std::size_t>(TcPart::schedule) + 1);

/// An export under way, to which stages and model append.
struct TcDraft : TcExport {
  double state_delay_ms = 0.0;  ///< delay of the model
  double loss = 0.0;            ///< in addition to the model's
  bool delays_vary = false;

  /// Whether the command has this option already.
  bool has(const std::string& option) const {
    return command.find(" " + option + " ") != std::string::npos;
  }
};

/// Number in tc's syntax: "12.5%", "0.25ms".
std::string tc_percent(double probability);
std::string tc_time(double milliseconds);

/// ` loss random 3%`, for independent losses; "" if there are none.
std::string tc_random_loss(double loss);

/// Loss of a packet that passes two losses.
double loss_of_either(double loss, double other);

/// Bytes of an Ethernet frame with a short LCM message (one fragment, over UDP and IPv4) that are
/// not the message's own.
double frame_overhead_bytes(const std::string& channel);

}  // namespace tether
