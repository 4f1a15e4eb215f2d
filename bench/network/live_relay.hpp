#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "bench/cpu_time.hpp"
#include "bench/network/bare_forwarder.hpp"
#include "common/lcm/udpm_bus.hpp"
#include "common/node/real_time_loop.hpp"
#include "tools/nodes/node_process.hpp"

namespace tether::bench {

/// How messages go from this process and back: over one LCM network; from one to another through a
/// bare forwarder; or through tether-netem.
enum class Way : std::uint8_t { plain, bare, relayed };

/// tether-netem as a process that relays DATA from one LCM network to another, and this process,
/// which sends on the first and listens on both; and beside it the two ways without it, each on
/// networks of its own. The channel's overrides apply to the rule's link.
///
/// Everything throws std::runtime_error, with what the process wrote, if it ends.
class LiveRelay {
 public:
  static constexpr char kNear[] = "udpm://239.255.76.67:7667?ttl=0";
  static constexpr char kFar[] = "udpm://239.255.76.67:7668?ttl=0";
  static constexpr char kPlain[] = "udpm://239.255.76.67:7669?ttl=0";
  static constexpr char kBareNear[] = "udpm://239.255.76.67:7670?ttl=0";
  static constexpr char kBareFar[] = "udpm://239.255.76.67:7671?ttl=0";
  static constexpr char kChannel[] = "DATA";
  /// A message's number, when it was heard, on now_ns()'s clock.
  using Heard = std::function<void(std::uint32_t number, std::int64_t when_ns)>;

  explicit LiveRelay(const std::vector<std::string>& overrides);
  ~LiveRelay();
  LiveRelay(const LiveRelay&) = delete;
  LiveRelay& operator=(const LiveRelay&) = delete;

  /// Sends a message of `bytes`, at least 4.
  void send(Way way, std::uint32_t number, std::size_t bytes);
  /// Receives each message that has gone that way from now on; null: no receiver.
  void on_heard(Way way, Heard heard) { line(way).heard = std::move(heard); }
  /// The same for messages to the relay. Listening there starts with the first call: it costs as
  /// much as listening on the far network.
  void on_near(Heard heard);

  /// Lives for `time`, or until `done`.
  void run_for(
      Duration time, const std::function<bool()>& done = [] { return false; });
  RealTimeLoop& loop() { return loop_; }
  /// CPU time that the relay has used so far.
  double cpu_s() const { return cpu_seconds(relay_->pid()); }

  /// CLOCK_MONOTONIC.
  static std::int64_t now_ns();

 private:
  /// Where messages enter a way, and where they come out.
  struct Line {
    UdpmBus out;
    UdpmBus in;
    Heard heard{};
  };

  Line& line(Way way) { return lines_[static_cast<std::size_t>(way)]; }
  static void listen(UdpmBus& bus, Heard& heard);

  RealTimeLoop loop_;
  std::array<Line, 3> lines_;  // by Way
  UdpmBus near_;
  Heard near_heard_;
  BareForwarder forwarder_;
  std::vector<std::uint8_t> bytes_;
  std::string said_;
  bool hears_near_ = false;
  bool running_ = false;
  bool ending_ = false;
  std::string failure_;
  std::unique_ptr<NodeProcess> relay_;
};

}  // namespace tether::bench
