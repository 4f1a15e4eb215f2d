#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/base/time.hpp"

namespace tether::test {

/// A time of more than 0.5 ms in which the machine did nothing for the sender, which had slept its
/// time out or was sending: it did something else.
struct Pause {
  std::int64_t begin_ns = 0;
  std::int64_t end_ns = 0;
};

/// Fates of packets 0, 1, … in the kernel. All times by its wall clock, in ns since 1970.
struct KernelRun {
  std::vector<std::int64_t> sent_ns;      ///< send_paced(): just before it was handed over
  std::vector<std::int64_t> received_ns;  ///< when it came out of the interface's queue; 0: never
  std::vector<Pause> pauses;              ///< send_paced(): ascending

  /// How many there are of those whose number divided by `lanes` leaves `lane`.
  std::int64_t received(std::size_t lane = 0, std::size_t lanes = 1) const;

  /// t, or where t lies in a pause, its end: nothing was done earlier than that.
  std::int64_t after_pause(std::int64_t t_ns) const;
};

/// Sends UDP packets to itself over 127.0.0.1 and notes what comes back when, by the kernel's own
/// time stamps. One thread, so that on a single processor nothing waits for another process to be
/// woken: only the kernel works between a packet's departure and its time stamp.
class UdpProbe {
 public:
  /// Throws std::system_error, as do the others.
  UdpProbe();
  ~UdpProbe();
  UdpProbe(const UdpProbe&) = delete;
  UdpProbe& operator=(const UdpProbe&) = delete;

  /// Sends at full speed, with socket priority 0. Packets with priority 1 must get through at once:
  /// one follows every few packets and says that the kernel is done with these, so that none of its
  /// queues but that of the interface can ever overflow.
  KernelRun send_burst(std::size_t packets);

  /// A packet every `interval`, or as soon after that as the machine can. Packet i has the socket
  /// priority i modulo `lanes` (up to 3).
  KernelRun send_paced(std::size_t packets, Duration interval, std::size_t lanes);

 private:
  void send(std::size_t first, std::size_t count, std::size_t lane);
  bool collect(KernelRun& run);
  void await_marker(KernelRun& run);
  void collect_rest(KernelRun& run);

  std::vector<int> senders_;
  int receiver_ = -1;
};

}  // namespace tether::test
