#pragma once

#include <string>
#include <vector>

namespace tether {

/// Who sends what a link impairs.
struct TcSender {
  std::string interface;    ///< of the sender's computer, towards the network
  std::string channel;      ///< LCM channel, whose name is in every packet
  double interval_s = 1.0;  ///< between packets
};

/// A link as tc-netem(8) of iproute2 6.1 and net/sched/sch_netem.c of Linux 6.18 do it.
struct TcExport {
  std::string command;  ///< `tc qdisc add dev … root netem …`, with all that has an equivalent
  /// What the command lacks or does otherwise, and why; one line each.
  std::vector<std::string> notes;
};

/// As tc reads numbers: "12.5%", "0.25ms".
std::string tc_percent(double probability);
std::string tc_time(double milliseconds);

/// ` loss random 3%`, for independent losses; "" if there are none.
std::string tc_random_loss(double loss);

/// Of a packet that passes two losses.
double loss_of_either(double loss, double other);

}  // namespace tether
