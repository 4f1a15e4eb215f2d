#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "bench/cpu_time.hpp"
#include "common/lcm_bus.hpp"
#include "common/real_time_loop.hpp"
#include "tools/node_process.hpp"

namespace tether::bench {

/// tether-netem as a process that relays DATA from one LCM network to another, and this process,
/// which sends on the first and listens on both; and on a third, which the relay is not on. The
/// channel's overrides apply to the rule's link.
///
/// Everything throws std::runtime_error, with what the process wrote, if it ends.
class LiveRelay {
 public:
  static constexpr char kNear[] = "udpm://239.255.76.67:7667?ttl=0";
  static constexpr char kFar[] = "udpm://239.255.76.67:7668?ttl=0";
  static constexpr char kPlain[] = "udpm://239.255.76.67:7669?ttl=0";
  static constexpr char kChannel[] = "DATA";
  /// A message's number, when it was heard, on now_ns()'s clock.
  using Heard = std::function<void(std::uint32_t number, std::int64_t when_ns)>;

  explicit LiveRelay(const std::vector<std::string>& overrides);
  ~LiveRelay();
  LiveRelay(const LiveRelay&) = delete;
  LiveRelay& operator=(const LiveRelay&) = delete;

  /// Sends a message of `bytes`, at least 4, to the relay or on the third network.
  void send(std::uint32_t number, std::size_t bytes) { send(out_, number, bytes); }
  void send_plain(std::uint32_t number, std::size_t bytes) { send(plain_out_, number, bytes); }
  /// Is told of each message from now on; null for nobody. Listening on the first network starts
  /// with the first call: it costs as much as listening on the far one.
  void on_near(Heard heard);
  void on_far(Heard heard) { far_heard_ = std::move(heard); }
  void on_plain(Heard heard) { plain_heard_ = std::move(heard); }

  /// Lives for `time`, or until `done`.
  void run_for(
      Duration time, const std::function<bool()>& done = [] { return false; });
  RealTimeLoop& loop() { return loop_; }
  /// CPU time that the relay has used so far.
  double cpu_s() const { return cpu_seconds(relay_->pid()); }

  /// CLOCK_MONOTONIC.
  static std::int64_t now_ns();

 private:
  static void listen(LcmBus& bus, Heard& heard);
  void send(LcmBus& bus, std::uint32_t number, std::size_t bytes);

  RealTimeLoop loop_;
  LcmBus out_;
  LcmBus near_;
  LcmBus far_;
  LcmBus plain_out_;
  LcmBus plain_;
  Heard near_heard_;
  Heard far_heard_;
  Heard plain_heard_;
  std::vector<std::uint8_t> bytes_;
  std::string said_;
  bool hears_near_ = false;
  bool running_ = false;
  bool ending_ = false;
  std::string failure_;
  std::unique_ptr<NodeProcess> relay_;
};

}  // namespace tether::bench
